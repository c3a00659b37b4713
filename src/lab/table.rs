//! Tables of text whose rows are printed one by one, so their columns have fixed widths.

/// Columns of a table.
#[derive(Clone, Debug)]
pub struct Table {
    columns: Vec<(String, isize)>,
}

impl Table {
    /// Creates a table from the title and the width of each column. A negative width aligns the
    /// cells to the left. A title may have several lines.
    pub fn new<T: Into<String>>(columns: impl IntoIterator<Item = (T, isize)>) -> Table {
        let columns = columns.into_iter();
        Table {
            columns: columns
                .map(|(title, width)| (title.into(), width))
                .collect(),
        }
    }

    /// Returns the titles.
    pub fn header(&self) -> String {
        let titles = || self.columns.iter().map(|(title, _)| title);
        let lines = titles().map(|title| title.lines().count()).max();
        let line = |k| self.row(titles().map(move |title| title.lines().nth(k).unwrap_or("")));
        (0..lines.unwrap_or(0))
            .map(line)
            .collect::<Vec<_>>()
            .join("\n")
    }

    /// Returns a row. A cell that is wider than its column shifts the others.
    pub fn row<T: AsRef<str>>(&self, cells: impl IntoIterator<Item = T>) -> String {
        let mut row = String::new();
        for (cell, (_, width)) in cells.into_iter().zip(&self.columns) {
            let (cell, room) = (cell.as_ref(), width.unsigned_abs());
            row += &match width {
                ..0 => format!("{cell:room$} "),
                _ => format!("{cell:>room$} "),
            };
        }
        row.truncate(row.trim_end().len());
        row
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cells_are_aligned_below_their_titles() {
        let table = Table::new([("case", -6), ("1 thread\nms", 9), ("\nns", 4)]);
        assert_eq!(table.header(), "case    1 thread\n              ms   ns");
        assert_eq!(table.row(["a", "1.5", "2"]), "a            1.5    2");
        assert_eq!(table.row(["longer than", "1"]), "longer than         1");
    }
}
