//! Order of model files: a shell sorts `F1 F10 F2`, but the frames of a motion are `F1 F2 F10`.

use std::cmp::Ordering;
use std::path::PathBuf;

/// Part of a name: text, or a decimal number.
#[derive(Debug, PartialEq, Eq)]
enum Part<'a> {
    Text(&'a str),
    /// Integer digits without leading zeros, and the digits after a decimal point.
    Number(&'a str, &'a str),
}

/// Splits a name into texts and numbers.
fn parts(name: &str) -> Vec<Part<'_>> {
    let digits = |s: &str| s.len() - s.trim_start_matches(|c: char| c.is_ascii_digit()).len();
    let mut parts = Vec::new();
    let mut rest = name;
    while !rest.is_empty() {
        let (whole, after) = rest.split_at(digits(rest));
        if whole.is_empty() {
            let end = rest.find(|c: char| c.is_ascii_digit());
            let (text, after) = rest.split_at(end.unwrap_or(rest.len()));
            parts.push(Part::Text(text));
            rest = after;
            continue;
        }
        let fraction = after.strip_prefix('.').map_or("", |f| &f[..digits(f)]);
        parts.push(Part::Number(whole.trim_start_matches('0'), fraction));
        rest = match fraction {
            "" => after,
            fraction => &after[1 + fraction.len()..],
        };
    }
    parts
}

/// Compares two names that differ only in their numbers, by these numbers. Returns `None` if they
/// differ in anything else.
fn compare(a: &str, b: &str) -> Option<Ordering> {
    let (a, b) = (parts(a), parts(b));
    if a.len() != b.len() {
        return None;
    }
    let mut order = Ordering::Equal;
    for pair in a.iter().zip(&b) {
        match pair {
            (Part::Text(a), Part::Text(b)) if a == b => {}
            (Part::Number(a, f), Part::Number(b, g)) => {
                let whole = a.len().cmp(&b.len()).then_with(|| a.cmp(b));
                order = order.then(whole).then_with(|| f.cmp(g));
            }
            _ => return None,
        }
    }
    Some(order)
}

/// Sorts files by the numbers in their names, if the names differ in nothing else. Returns true if
/// the order changed.
pub fn sort(files: &mut [PathBuf]) -> bool {
    let Some((first, others)) = files.split_first() else {
        return false;
    };
    let name = |path: &PathBuf| path.to_string_lossy().into_owned();
    let first = name(first);
    if others
        .iter()
        .any(|file| compare(&first, &name(file)).is_none())
    {
        return false;
    }
    let sorted = |w: &[PathBuf; 2]| compare(&name(&w[0]), &name(&w[1])) != Some(Ordering::Greater);
    if files.array_windows().all(sorted) {
        return false;
    }
    files.sort_by(|a, b| compare(&name(a), &name(b)).unwrap_or(Ordering::Equal));
    true
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sorted(names: &[&str]) -> (Vec<String>, bool) {
        let mut files: Vec<PathBuf> = names.iter().map(PathBuf::from).collect();
        let changed = sort(&mut files);
        let names = files.iter().map(|f| f.display().to_string());
        (names.collect(), changed)
    }

    #[test]
    fn sorts_numbered_files_by_number() {
        let cases: [&[&str]; 6] = [
            &["F1.bcc", "F2.bcc", "F10.bcc"],
            &["run 3/F1.bcc", "run 20/F0.bcc", "run 20/F1.bcc"],
            &["t0.bcc", "t0.25.bcc", "t0.5.bcc", "t1.125.bcc", "t10.bcc"],
            &[
                "F0008",
                "F9",
                "F010",
                "F99999999999999999999999",
                "F100000000000000000000000",
            ],
            &["F1", "F01", "F2"],
            &["F1.bcc"],
        ];
        for expected in cases {
            let mut reversed = expected.to_vec();
            reversed.reverse();
            let (names, changed) = sorted(&reversed);
            assert_eq!(changed, expected.len() > 1, "{names:?}");
            match expected[0] {
                // Equal numbers keep their order.
                "F1" => assert_eq!(names, ["F01", "F1", "F2"]),
                _ => assert_eq!(names, expected),
            }
            assert!(!sorted(expected).1);
        }
    }

    #[test]
    fn keeps_the_given_order_of_other_files() {
        for names in [
            &["start.bcc", "end.bcc"][..],
            &["b2.bcc", "a1.bcc"],
            &["F2.bcc", "F1.obj"],
            &["F2.bcc", "F.bcc"],
            &[],
        ] {
            let (sorted, changed) = sorted(names);
            assert_eq!(sorted, names);
            assert!(!changed);
        }
    }
}
