//! Order of model files: a shell sorts `F1 F10 F2`, but the frames of a motion are `F1 F2 F10`.

use std::path::PathBuf;

/// Part of a name: text, or a decimal number. Numbers come first, ordered by value.
#[derive(Debug, PartialEq, Eq, PartialOrd, Ord)]
enum Part<'a> {
    /// Number of integer digits, these digits without leading zeros, and those after a decimal
    /// point.
    Number(usize, &'a str, &'a str),
    Text(&'a str),
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
        let whole = whole.trim_start_matches('0');
        parts.push(Part::Number(whole.len(), whole, fraction));
        rest = match fraction {
            "" => after,
            fraction => &after[1 + fraction.len()..],
        };
    }
    parts
}

/// Returns the sort key of a path: its folders one by one, and the name of the file before its
/// extension, so that `out.obj` comes before `out1.obj`.
fn key(path: &str) -> Vec<Vec<Part<'_>>> {
    let names = path.split(['/', '\\']).flat_map(name_and_extension);
    names.map(parts).collect()
}

/// Splits a name before its extension, which does not begin with a digit: `t0.25` has none.
fn name_and_extension(name: &str) -> [&str; 2] {
    match name.rsplit_once('.') {
        Some((stem, extension)) if !extension.starts_with(|c: char| c.is_ascii_digit()) => {
            [stem, extension]
        }
        _ => [name, ""],
    }
}

/// Returns true if the names differ in nothing but their numbers.
fn same_texts(a: &str, b: &str) -> bool {
    let text = |part| match part {
        Part::Text(text) => Some(text),
        Part::Number(..) => None,
    };
    let texts = |name| parts(name).into_iter().map(text);
    texts(a).eq(texts(b))
}

/// Returns a name as shells compare it in most languages: without punctuation and case.
fn letters(name: &str) -> String {
    let letters = name.chars().filter(|c| c.is_alphanumeric());
    letters.flat_map(char::to_lowercase).collect()
}

/// Sorts files by the numbers in their names. Files keep their order if somebody chose it: if their
/// names differ in more than numbers, and the order is not the alphabetical one of a shell, with or
/// without punctuation. Returns true if the order changed.
pub fn sort(files: &mut [PathBuf]) -> bool {
    let name = |file: &PathBuf| file.to_string_lossy().into_owned();
    let names: Vec<String> = files.iter().map(name).collect();
    let numbered = names.array_windows().all(|[a, b]| same_texts(a, b));
    let of_shell = names.is_sorted() || names.is_sorted_by_key(|name| letters(name));
    if !(numbered || of_shell) || names.is_sorted_by_key(|name| key(name)) {
        return false;
    }
    sort_by_number(files);
    true
}

/// Sorts files by the numbers in their names, also if somebody chose another order.
pub fn sort_by_number(files: &mut [PathBuf]) {
    files.sort_by(|a, b| key(&a.to_string_lossy()).cmp(&key(&b.to_string_lossy())));
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
    fn a_file_without_a_number_comes_before_those_with_one() {
        for (shell, expected) in [
            (
                ["out.obj", "out1.obj", "out10.obj", "out2.obj"],
                ["out.obj", "out1.obj", "out2.obj", "out10.obj"],
            ),
            // The order of a shell in English.
            (
                ["out10.obj", "out1.obj", "out2.obj", "out.obj"],
                ["out.obj", "out1.obj", "out2.obj", "out10.obj"],
            ),
            (
                ["out-1.obj", "out-10.obj", "out-2.obj", "out.obj"],
                ["out.obj", "out-1.obj", "out-2.obj", "out-10.obj"],
            ),
            (
                ["run/F.bcc", "run/F1.bcc", "run10/F.bcc", "run2/F.bcc"],
                ["run/F.bcc", "run/F1.bcc", "run2/F.bcc", "run10/F.bcc"],
            ),
        ] {
            assert_eq!(sorted(&shell), (expected.map(String::from).to_vec(), true));
        }
    }

    #[test]
    fn replaces_the_order_of_a_shell_even_if_names_differ_in_more_than_numbers() {
        let (names, changed) = sorted(&["F1.bcc", "F10.bcc", "F2.bcc", "F2b.bcc", "end.bcc"]);
        assert_eq!(names, ["F1.bcc", "F2.bcc", "F2b.bcc", "F10.bcc", "end.bcc"]);
        assert!(changed);
    }

    #[test]
    fn keeps_the_given_order_of_other_files() {
        for names in [
            &["start.bcc", "end.bcc"][..],
            &["b2.bcc", "a1.bcc"],
            &["F2.bcc", "F1.obj"],
            &["G2.bcc", "F.bcc"],
            &[],
        ] {
            let (sorted, changed) = sorted(names);
            assert_eq!(sorted, names);
            assert!(!changed);
        }
    }
}
