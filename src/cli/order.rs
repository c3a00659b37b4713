//! Order of model files: a shell sorts `F1 F10 F2`, but the frames of a motion are `F1 F2 F10`.

use std::collections::HashSet;
use std::path::PathBuf;

/// Part of a name: text, or a decimal number. Numbers come first, ordered by value.
#[derive(Debug, PartialEq, Eq, PartialOrd, Ord)]
enum Part {
    /// Number of integer digits, these digits without leading zeros, those after a decimal point,
    /// and whether the number has an exponent, which is applied to the digits.
    Number(usize, String, String, bool),
    Text(String),
}

/// How numbers in names are read.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
enum Reading {
    /// Digits after a point count as a separate number.
    Counts,
    /// Digits after a point belong to the number before it.
    Decimals,
    /// Decimals, which may have an exponent.
    Exponents,
}

/// Splits a name into texts and numbers.
fn parts(name: &str, reading: Reading) -> Vec<Part> {
    let decimals = reading != Reading::Counts;
    let digits = |s: &str| s.len() - s.trim_start_matches(|c: char| c.is_ascii_digit()).len();
    let mut parts = Vec::new();
    let mut rest = name;
    while !rest.is_empty() {
        let (whole, after) = rest.split_at(digits(rest));
        if whole.is_empty() {
            let end = rest.find(|c: char| c.is_ascii_digit());
            let (text, after) = rest.split_at(end.unwrap_or(rest.len()));
            parts.push(Part::Text(text.into()));
            rest = after;
            continue;
        }
        let fraction = after.strip_prefix('.').filter(|_| decimals);
        let fraction = fraction.map_or("", |f| &f[..digits(f)]);
        rest = match fraction {
            "" => after,
            fraction => &after[1 + fraction.len()..],
        };
        let exponent = exponent(rest).filter(|_| reading == Reading::Exponents);
        let (by, after) = exponent.unwrap_or((0, rest));
        rest = after;
        let [whole, fraction] = scaled(whole, fraction, by);
        let whole = whole.trim_start_matches('0').to_owned();
        let has_exponent = exponent.is_some();
        parts.push(Part::Number(whole.len(), whole, fraction, has_exponent));
    }
    parts
}

/// Splits an exponent with a sign from the start of a text: `e-05`.
fn exponent(text: &str) -> Option<(i32, &str)> {
    let signed = text.strip_prefix(['e', 'E'])?;
    let digits = signed.strip_prefix(['+', '-'])?;
    let rest = digits.trim_start_matches(|c: char| c.is_ascii_digit());
    let number = &signed[..signed.len() - rest.len()];
    // A sign and at most three digits, as programs write it.
    let by = number.parse().ok().filter(|_| number.len() <= 4)?;
    Some((by, rest))
}

/// Returns the digits before and after the point of a number times a power of 10.
fn scaled(whole: &str, fraction: &str, by: i32) -> [String; 2] {
    let mut digits = format!("{whole}{fraction}");
    let point = whole.len() as i32 + by;
    let zeros = |n: i32| "0".repeat(n.max(0) as usize);
    digits.insert_str(0, &zeros(-point));
    digits += &zeros(point - digits.len() as i32);
    let fraction = digits.split_off(point.max(0) as usize);
    [digits, fraction]
}

/// Returns the sort key of a path: its folders one by one, and the name of the file before its
/// extension, so that `out.obj` comes before `out1.obj`.
fn key(path: &str, reading: Reading) -> Vec<Vec<Part>> {
    let names = path.split(['/', '\\']).flat_map(name_and_extension);
    names.map(|name| parts(name, reading)).collect()
}

/// Returns the digits after a point of each number in the name of a file. Those of a number with an
/// exponent are decimals, and left out.
fn fractions(name: &str) -> Vec<String> {
    let file = name.rsplit(['/', '\\']).next().unwrap_or(name);
    let digits = |part| match part {
        Part::Number(_, _, digits, false) => Some(digits),
        Part::Number(..) => Some(String::new()),
        Part::Text(_) => None,
    };
    let parts = parts(file, Reading::Exponents).into_iter();
    parts.filter_map(digits).collect()
}

/// Returns how the numbers in names are read. Digits after a point count, as in `run2.9`,
/// `run2.10`, if they differ in length, and some end with 0. Numbers have exponents if those before
/// the exponents differ, or have decimals: `take1e-01`, `take1e-02` have none.
fn reading(names: &[String]) -> Reading {
    let of_files: Vec<Vec<_>> = names.iter().map(|name| fractions(name)).collect();
    let most = of_files.iter().map(Vec::len).max().unwrap_or(0);
    let are_counts = (0..most).any(|k| {
        let same_place = of_files.iter().filter_map(|file| file.get(k));
        let mut same_place = same_place.filter(|digits| !digits.is_empty());
        let lengths: HashSet<usize> = same_place.clone().map(String::len).collect();
        // A time of `0.000` is no count.
        let counts = |d: &String| d.ends_with('0') && !d.trim_matches('0').is_empty();
        lengths.len() > 1 && same_place.any(counts)
    });
    if are_counts {
        return Reading::Counts;
    }
    let mut before = HashSet::new();
    let mut has_decimals = false;
    for name in names {
        for three in parts(name, Reading::Decimals).array_windows() {
            if let [
                Part::Number(_, whole, digits, _),
                Part::Text(sign),
                Part::Number(..),
            ] = three
                && ["e-", "e+", "E-", "E+"].contains(&sign.as_str())
            {
                has_decimals |= !digits.is_empty();
                before.insert(whole.clone());
            }
        }
    }
    match before.len() > 1 || has_decimals {
        true => Reading::Exponents,
        false => Reading::Decimals,
    }
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
fn same_texts(a: &str, b: &str, reading: Reading) -> bool {
    let text = |part| match part {
        Part::Text(text) => Some(text),
        Part::Number(..) => None,
    };
    let texts = |name| parts(name, reading).into_iter().map(text);
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
    let names = names(files);
    let reading = reading(&names);
    // Digits after a point may be there in some names only: `t0`, `t0.25`.
    let texts = reading.max(Reading::Decimals);
    let numbered = names.array_windows().all(|[a, b]| same_texts(a, b, texts));
    let of_shell = names.is_sorted() || names.is_sorted_by_key(|name| letters(name));
    if !(numbered || of_shell) || names.is_sorted_by_key(|name| key(name, reading)) {
        return false;
    }
    sort_by_number(files);
    true
}

/// Sorts files by the numbers in their names, also if somebody chose another order.
pub fn sort_by_number(files: &mut [PathBuf]) {
    let reading = reading(&names(files));
    files.sort_by_cached_key(|file| key(&file.to_string_lossy(), reading));
}

/// Returns true if the files would have another order if digits after a point were read in the
/// other way (`run1.5` before `run1.15`, or `0.15` before `0.5`), and no name decides it.
pub fn is_unclear(files: &[PathBuf]) -> bool {
    let names = names(files);
    let reading = reading(&names);
    let in_order = |reading| names.is_sorted_by_key(|name| key(name, reading));
    let all = names.iter().flat_map(|name| fractions(name));
    let all: Vec<_> = all.filter(|digits| !digits.is_empty()).collect();
    // No count begins with 0.
    let is_decimal = |digits: &String| digits.len() > 1 && digits.starts_with('0');
    let decided = all.iter().any(is_decimal);
    reading != Reading::Counts
        && !all.is_empty()
        && !decided
        && in_order(reading) != in_order(Reading::Counts)
}

fn names(files: &[PathBuf]) -> Vec<String> {
    let name = |file: &PathBuf| file.to_string_lossy().into_owned();
    files.iter().map(name).collect()
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
        let cases: [&[&str]; 9] = [
            &["1e-05.obj", "2e-05.obj", "1e-04.obj"],
            &["v1e-01.obj", "v1e-02.obj", "v1e-10.obj", "v1e-0011.obj"],
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
            &[
                "t0.0e+00.obj",
                "t9.5e-05.obj",
                "t1.00E-4.obj",
                "t3e-01.obj",
                "t2.5.obj",
                "t1e+10.obj",
            ],
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
    fn digits_after_a_point_may_be_a_number() {
        for names in [
            ["knit2.1.obj", "knit2.9.obj", "knit2.10.obj", "knit2.24.obj"],
            [
                "dump.run1.0",
                "dump.run1.100",
                "dump.run1.200",
                "dump.run1.1000",
            ],
            ["v1.10/t0.25", "v1.10/t0.5", "v1.10/t1.0", "v1.10/t1.125"],
            ["t0.25_r0.10", "t0.5_r0.10", "t1_r0.10", "t1.25_r0.10"],
            ["t0.000", "t0.25", "t0.5", "t1"],
            [
                "run2.10_t0.125",
                "run2.10_t0.5",
                "run2.10_t1.25",
                "run2.10_t2.5",
            ],
        ] {
            let mut shell = names.to_vec();
            shell.sort();
            assert_eq!(sorted(&shell).0, names);
            assert_eq!(sorted(&names), (names.map(String::from).to_vec(), false));
        }
        let unclear = |names: &[&str]| {
            let files: Vec<PathBuf> = names.iter().map(PathBuf::from).collect();
            is_unclear(&files)
        };
        assert!(unclear(&["run1.15", "run1.25", "run1.5"]));
        assert!(!unclear(&["t0.25", "t0.50", "t1.00"]));
        assert!(!unclear(&["t0.05", "t0.1", "t0.15"]));
        assert!(!unclear(&["run2.9", "run2.10", "run2.11"]));
        assert!(!unclear(&["F1.obj", "F2.obj", "F10.obj"]));
    }

    #[test]
    fn a_file_without_a_number_comes_before_those_with_one() {
        for (shell, expected) in [
            (
                ["out.obj", "out1.obj", "out10.obj", "out2.obj"],
                ["out.obj", "out1.obj", "out2.obj", "out10.obj"],
            ),
            // The order in which a shell with an English locale lists these files.
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
