//! Structure of a binary USD file: which prim has which attributes, and where their values are.

use super::FORMAT;
use super::binary::{Binary, Rep, kind};
use super::layer::{ATTRIBUTES, Attribute, Layer, Place, Prim, Value, arc};
use super::packed::{block, decompress, integers, take};
use super::tokens::Tokens;
use crate::error::{Error, Result};
use std::collections::HashMap;
use std::io::{Read, Seek};

/// Maximum number of fields of a prim or attribute. Lists of fields are shared, so that without
/// this limit a small file could describe a huge number of them.
const FIELDS: usize = 4096;
/// Maximum number of sections.
const SECTIONS: u64 = 64;
/// Marks the end of a list of fields, and paths without a parent.
const NONE: u32 = u32::MAX;

/// Numbers of types of specs.
const ATTRIBUTE: i32 = 1;
const PRIM: i32 = 6;
const ROOT: i32 = 7;

/// Name of a path, and the path that it extends.
#[derive(Clone, Copy, Debug)]
struct Step {
    parent: u32,
    token: u32,
    property: bool,
}

/// Paths of a file. They are stored as a tree in depth-first order: for each, its number, its name
/// (negative for properties), and a jump: -2 for a leaf without later siblings, -1 for a path with
/// children only, 0 with a later sibling only, else the distance to the next sibling, after the
/// children.
#[derive(Debug)]
struct Paths(Vec<Option<Step>>);

impl Paths {
    fn new(count: u64, tree: [Vec<i32>; 3]) -> Result<Paths, String> {
        let [numbers, names, jumps] = tree;
        // The empty path has a number, but no place in the tree.
        if count > numbers.len() as u64 + 1 {
            return Err(format!("{count} paths promised, {} found", numbers.len()));
        }
        let mut paths = vec![None; count as usize];
        let mut seen = vec![false; numbers.len()];
        let mut pending = vec![(0, NONE)];
        while let Some((mut at, mut parent)) = pending.pop() {
            while at < numbers.len() {
                if std::mem::replace(&mut seen[at], true) {
                    return Err(format!("path {at} of the tree has two places"));
                }
                let number = numbers[at] as u32;
                let step = Step {
                    parent,
                    token: names[at].unsigned_abs(),
                    property: names[at] < 0,
                };
                match paths.get_mut(number as usize) {
                    Some(path @ None) => *path = Some(step),
                    Some(Some(_)) => return Err(format!("path {number} occurs twice")),
                    None => return Err(format!("path {number} of {count}")),
                }
                let jump = jumps[at];
                if jump > 0 {
                    pending.push((at + jump as usize, parent));
                }
                match jump {
                    1.. | -1 => parent = number,
                    0 => {}
                    _ => break,
                }
                at += 1;
            }
        }
        Ok(Paths(paths))
    }
}

/// Fields and specs of a file.
pub(super) struct Structure {
    paths: Paths,
    fields: Vec<(u32, Rep)>,
    /// Fields of all lists, each ended by [`NONE`].
    lists: Vec<u32>,
    /// First field and type of the spec of each path, if it has one.
    specs: Vec<Option<(u32, i32)>>,
}

impl Structure {
    /// Reads all sections, and the words of `file`.
    pub fn read<R: Read + Seek>(file: &mut Binary<R>) -> Result<Structure> {
        let toc = file.input.u64_at(16)?;
        let count = file.input.u64_at(toc)?;
        if count > SECTIONS {
            let what = format!("{count} sections, expected at most {SECTIONS}");
            return Err(Error::format(FORMAT, format_args!("byte {toc}"), what));
        }
        let table = file.input.bytes(toc + 8, 32 * count)?;
        let mut section = |name: &str| -> Result<Vec<u8>> {
            let mut rows = table.as_chunks::<32>().0.iter();
            let named = |row: &&[u8; 32]| {
                row[..16]
                    .strip_prefix(name.as_bytes())
                    .is_some_and(|rest| rest.iter().all(|&b| b == 0))
            };
            let Some(row) = rows.find(named) else {
                return Err(Error::format(FORMAT, "sections", format!("no {name}")));
            };
            let [start, size] = [16, 24].map(|k| {
                let bytes = row[k..k + 8].first_chunk().copied().unwrap_or_default();
                u64::from_le_bytes(bytes)
            });
            file.input.bytes(start, size)
        };
        let [tokens, strings, fields, lists, paths, specs] =
            ["TOKENS", "STRINGS", "FIELDS", "FIELDSETS", "PATHS", "SPECS"].map(&mut section);
        let limit = file.limit();
        let in_section = |name: &'static str| {
            move |what: String| Error::format(FORMAT, format_args!("section {name}"), what)
        };
        let bytes = file.input.len();
        file.tokens = Tokens::read(&tokens?, bytes).map_err(in_section("TOKENS"))?;
        file.tokens.strings = numbers_of_strings(&strings?).map_err(in_section("STRINGS"))?;
        let fields = fields_of(&fields?, limit).map_err(in_section("FIELDS"))?;
        let lists = columns::<1>(&mut &lists?[..], limit).map_err(in_section("FIELDSETS"))?;
        let lists = lists.into_iter().flatten().map(|i| i as u32).collect();
        let paths = paths_of(&paths?, limit).map_err(in_section("PATHS"))?;
        let specs = specs_of(&specs?, paths.0.len(), limit).map_err(in_section("SPECS"))?;
        Ok(Structure {
            paths,
            fields,
            lists,
            specs,
        })
    }

    /// Reads the prims of the file, and the places of values that curves need.
    pub fn layer<R: Read + Seek>(&self, file: &mut Binary<R>) -> Result<Layer> {
        let mut layer = Layer::default();
        // Prims and attributes below each path.
        let mut below: HashMap<u32, Vec<u32>> = HashMap::new();
        let mut root = None;
        for (k, (step, spec)) in (0_u32..).zip(self.paths.0.iter().zip(&self.specs)) {
            match (step, spec) {
                (_, Some((_, ROOT))) => root = Some(k),
                (Some(step), Some((_, ATTRIBUTE | PRIM))) => {
                    below.entry(step.parent).or_default().push(k);
                }
                _ => {}
            }
        }
        let Some(root) = root else {
            return Err(Error::format(FORMAT, "section SPECS", "no root"));
        };
        // Paths whose prims follow: the last one first.
        let mut pending = vec![(root, None)];
        while let Some((path, parent)) = pending.pop() {
            let mut prim = Prim {
                parent,
                ..Prim::default()
            };
            let children = match path == root {
                true => self.read_root(file, root, &mut layer)?,
                false => self.read_prim(file, path, &mut prim)?,
            };
            let mut by_name = HashMap::new();
            for &k in below.get(&path).into_iter().flatten() {
                let Some(step) = self.paths.0[k as usize] else {
                    continue;
                };
                if !step.property {
                    by_name.insert(file.name(step.token)?, k);
                    continue;
                }
                let name = file.name(step.token)?;
                if Attribute::matters(&name) {
                    if prim.attributes.len() == ATTRIBUTES {
                        let what = format!("more than {ATTRIBUTES} attributes of a prim");
                        return Err(Error::format(FORMAT, format_args!("path {path}"), what));
                    }
                    prim.attributes.push(self.read_attribute(file, k, name)?);
                }
            }
            let this = (path != root).then_some(layer.prims.len());
            if path != root {
                layer.prims.push(prim);
            }
            // The order of the file, which its paths do not keep.
            let ordered = children.iter().filter_map(|name| by_name.remove(name));
            let ordered: Vec<u32> = ordered.collect();
            pending.extend(ordered.into_iter().rev().map(|k| (k, this)));
        }
        Ok(layer)
    }

    /// Returns names and values of the fields of a path.
    fn fields<R>(&self, file: &Binary<R>, path: u32) -> Result<Vec<(String, Rep)>> {
        let bad = |what: String| Error::format(FORMAT, format_args!("path {path}"), what);
        let Some((first, _)) = self.specs[path as usize] else {
            return Ok(Vec::new());
        };
        let list = self.lists.get(first as usize..);
        let list = list.ok_or_else(|| bad(format!("list of fields {first}")))?;
        let mut fields = Vec::new();
        for &field in list.iter().take_while(|&&field| field != NONE) {
            if fields.len() == FIELDS {
                return Err(bad(format!("more than {FIELDS} fields")));
            }
            let field = self.fields.get(field as usize);
            let &(name, rep) = field.ok_or_else(|| bad("a field that is missing".into()))?;
            // Long names are those of fields that no curve needs.
            fields.push((file.tokens.word(name).unwrap_or_default().to_owned(), rep));
        }
        Ok(fields)
    }

    /// Reads the metadata of the layer. Returns the names of the prims at the top.
    fn read_root<R: Read + Seek>(
        &self,
        file: &mut Binary<R>,
        path: u32,
        layer: &mut Layer,
    ) -> Result<Vec<String>> {
        let mut children = Vec::new();
        for (name, rep) in self.fields(file, path)? {
            match name.as_str() {
                "timeCodesPerSecond" => layer.time_codes_per_second = file.double(rep)?,
                "framesPerSecond" => layer.frames_per_second = file.double(rep)?,
                "primChildren" => children = file.all_words(rep)?,
                _ => layer.arc = layer.arc.or(arc(&name)),
            }
        }
        Ok(children)
    }

    /// Reads the metadata of a prim. Returns the names of its children.
    fn read_prim<R: Read + Seek>(
        &self,
        file: &mut Binary<R>,
        path: u32,
        prim: &mut Prim,
    ) -> Result<Vec<String>> {
        let mut children = Vec::new();
        if let Some(step) = self.paths.0[path as usize] {
            prim.name = file.name(step.token)?;
        }
        for (name, rep) in self.fields(file, path)? {
            match name.as_str() {
                // 0 is `def`, 1 `over`, 2 `class`.
                "specifier" => prim.defined = rep.kind() == kind::SPECIFIER && rep.payload() == 0,
                "typeName" => prim.kind = file.all_words(rep)?.pop().unwrap_or_default(),
                "active" => prim.inactive = rep.kind() == kind::BOOL && rep.payload() == 0,
                "primChildren" => children = file.all_words(rep)?,
                _ => prim.arc = prim.arc.or(arc(&name)),
            }
        }
        Ok(children)
    }

    fn read_attribute<R: Read + Seek>(
        &self,
        file: &mut Binary<R>,
        path: u32,
        name: String,
    ) -> Result<Attribute> {
        let mut attribute = Attribute {
            name,
            ..Attribute::default()
        };
        for (name, rep) in self.fields(file, path)? {
            match name.as_str() {
                "default" => attribute.default = Some(Place(rep.0)),
                "timeSamples" => attribute.samples = file.samples(rep)?,
                "interpolation" => attribute.interpolation = file.all_words(rep)?.pop(),
                "spline" => attribute.spline = true,
                _ => {}
            }
        }
        Ok(attribute)
    }
}

impl<R: Read + Seek> Binary<R> {
    fn name(&self, token: u32) -> Result<String> {
        let word = self.tokens.word(token);
        let word = word.map_err(|what| Error::format(FORMAT, "section TOKENS", what))?;
        Ok(word.to_owned())
    }

    fn all_words(&mut self, rep: Rep) -> Result<Vec<String>> {
        match self.value(rep)? {
            Value::Words(words) => Ok(words),
            other => {
                let what = format!("{}, expected words", other.describe());
                Err(Error::format(FORMAT, rep.place(), what))
            }
        }
    }

    fn double(&mut self, rep: Rep) -> Result<Option<f64>> {
        match self.value(rep)? {
            Value::Doubles(1, v) => Ok(v.first().copied()),
            Value::Singles(1, v) => Ok(v.first().map(|&x| x.into())),
            _ => Ok(None),
        }
    }
}

fn number(section: &mut &[u8]) -> Result<u64, String> {
    let bytes = take(section).ok_or("the section ends early")?;
    Ok(u64::from_le_bytes(bytes))
}

fn numbers_of_strings(mut section: &[u8]) -> Result<Vec<u32>, String> {
    let count = number(&mut section)?;
    let numbers = section.as_chunks().0;
    if count > numbers.len() as u64 {
        return Err(format!("{count} strings promised, {} found", numbers.len()));
    }
    let numbers = &numbers[..count as usize];
    Ok(numbers.iter().map(|&b| u32::from_le_bytes(b)).collect())
}

/// Reads a number of rows, and so many integers for each of `N` columns.
fn columns<const N: usize>(section: &mut &[u8], limit: u64) -> Result<[Vec<i32>; N], String> {
    let count = number(section)?;
    let mut columns = [const { Vec::new() }; N];
    for column in &mut columns {
        *column = integers(block(section)?, count, limit)?;
    }
    Ok(columns)
}

fn fields_of(mut section: &[u8], limit: u64) -> Result<Vec<(u32, Rep)>, String> {
    let count = number(&mut { section })?;
    let [names] = columns::<1>(&mut section, limit)?;
    let reps = block(&mut section)?;
    let reps = decompress(reps, count.saturating_mul(8), true)?;
    let reps = reps
        .as_chunks()
        .0
        .iter()
        .map(|&b| Rep(u64::from_le_bytes(b)));
    Ok(names.into_iter().map(|i| i as u32).zip(reps).collect())
}

fn paths_of(mut section: &[u8], limit: u64) -> Result<Paths, String> {
    let count = number(&mut section)?;
    Paths::new(count, columns::<3>(&mut section, limit)?)
}

/// Returns the list of fields and the type of the spec of each of `paths` paths.
fn specs_of(
    mut section: &[u8],
    paths: usize,
    limit: u64,
) -> Result<Vec<Option<(u32, i32)>>, String> {
    let [numbers, lists, kinds] = columns::<3>(&mut section, limit)?;
    let mut specs = vec![None; paths];
    for ((number, list), kind) in numbers.into_iter().zip(lists).zip(kinds) {
        match specs.get_mut(number as u32 as usize) {
            Some(spec) => *spec = Some((list as u32, kind)),
            None => return Err(format!("path {} of {paths}", number as u32)),
        }
    }
    Ok(specs)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn tree(jumps: &[i32]) -> Result<Paths, String> {
        let numbers = (0..jumps.len() as i32).collect();
        Paths::new(
            jumps.len() as u64,
            [numbers, vec![1; jumps.len()], jumps.to_vec()],
        )
    }

    #[test]
    fn jumps_give_parents() {
        // A root with a child that has a child, and a sibling of the first child.
        let paths = tree(&[-1, 2, -2, -2]).unwrap();
        let parents: Vec<u32> = paths.0.iter().map(|step| step.unwrap().parent).collect();
        assert_eq!(parents, [NONE, 0, 1, 0]);
    }

    #[test]
    fn rejects_paths_with_two_places() {
        // Each path is its own child and sibling: 2^n places.
        assert!(tree(&[1; 60]).unwrap_err().contains("two places"));
        let twice = [vec![0, 0], vec![1, 2], vec![-1, -2]];
        assert!(
            Paths::new(2, twice)
                .unwrap_err()
                .contains("path 0 occurs twice")
        );
        let outside = [vec![0, 7], vec![1, 2], vec![-1, -2]];
        assert!(Paths::new(2, outside).unwrap_err().contains("path 7 of 2"));
        assert!(Paths::new(1 << 40, [vec![], vec![], vec![]]).is_err());
    }
}
