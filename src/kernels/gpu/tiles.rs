//! Work lists: all segment pairs of all pairs of curves, cut into tiles. Large pairs are split;
//! several small tiles share a workgroup.

use super::layout::Tile;

/// Maximum size of a tile.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Shape {
    /// Maximum number of rows. Each row is the work of one thread.
    pub rows: u32,
    /// Maximum number of columns. Each column is one step of a thread.
    pub columns: u32,
}

/// Cuts a tile into tiles no larger than `shape`.
pub(crate) fn cut(tile: Tile, shape: Shape, out: &mut Vec<Tile>) {
    for row in (0..tile.rows).step_by(shape.rows as usize) {
        for column in (0..tile.columns).step_by(shape.columns as usize) {
            out.push(Tile {
                first_row: tile.first_row + row,
                rows: shape.rows.min(tile.rows - row),
                first_column: tile.first_column + column,
                columns: shape.columns.min(tile.columns - column),
                ..tile
            });
        }
    }
}

/// Splits a list into consecutive batches. Each batch has at most `longest` tiles and at most
/// `most` segment pairs, unless it has only `step` tiles, the minimum. All batches but the last
/// have a multiple of `step` tiles.
pub(crate) fn parts(tiles: &[Tile], step: usize, longest: usize, most: u64) -> Vec<&[Tile]> {
    let pairs = |tile: &Tile| u64::from(tile.rows) * u64::from(tile.columns);
    let mut out = Vec::new();
    let mut rest = tiles;
    while !rest.is_empty() {
        let (mut count, mut work) = (0, 0);
        for chunk in rest.chunks(step) {
            let added: u64 = chunk.iter().map(pairs).sum();
            if count > 0 && (work + added > most || count + chunk.len() > longest) {
                break;
            }
            count += chunk.len();
            work += added;
        }
        let (part, others) = rest.split_at(count);
        out.push(part);
        rest = others;
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tiles_cover_every_pair_once() {
        let shape = Shape {
            rows: 16,
            columns: 64,
        };
        for [m, n] in [[3, 3], [16, 64], [17, 65], [100, 1000]] {
            let whole = Tile {
                pair: 7,
                first_row: 5,
                rows: m,
                first_column: 900,
                columns: n,
                ..Tile::default()
            };
            let mut tiles = Vec::new();
            cut(whole, shape, &mut tiles);
            let mut seen = vec![0; (m * n) as usize];
            for t in &tiles {
                assert!(t.pair == 7 && t.rows <= 16 && t.columns <= 64);
                for r in 0..t.rows {
                    for c in 0..t.columns {
                        let at = (t.first_row + r - 5) * n + t.first_column + c - 900;
                        seen[at as usize] += 1;
                    }
                }
            }
            assert!(seen.iter().all(|&s| s == 1));
        }
    }

    #[test]
    fn batches_are_bounded_and_contain_the_whole_list() {
        let tiles: Vec<Tile> = (1..100)
            .map(|k| Tile {
                pair: k,
                rows: k,
                columns: 10,
                ..Tile::default()
            })
            .collect();
        let parts = parts(&tiles, 8, 32, 5000);
        assert_eq!(parts.concat(), tiles);
        for (k, part) in parts.iter().enumerate() {
            assert!(part.len() <= 32 && (part.len() % 8 == 0 || k + 1 == parts.len()));
            let work: u32 = part.iter().map(|t| t.rows * t.columns).sum();
            assert!(work <= 5000 || part.len() <= 8);
        }
        assert!(super::parts(&[], 8, 8, 1).is_empty());
    }
}
