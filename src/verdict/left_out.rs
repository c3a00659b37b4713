//! Elements of a file that may be curves and were not read.

use std::borrow::Cow;
use std::fmt;

/// Elements of one kind that a reader did not read, although they may be curves.
///
/// A verdict on a frame that lacks curves of its file is incomplete (exit code 3).
#[derive(Clone, Debug, PartialEq, Eq, serde::Serialize)]
pub struct LeftOut {
    /// Number of the elements.
    pub count: u64,
    /// Their kind, singular and plural: `surface`, `surfaces`. JSON has the plural.
    #[serde(serialize_with = "plural")]
    pub kind: [Cow<'static, str>; 2],
    /// Place of the first one in the file, with its name if it has one: `line 12`.
    pub first: String,
}

fn plural<S: serde::Serializer>(kind: &[Cow<str>; 2], to: S) -> Result<S::Ok, S::Error> {
    to.serialize_str(&kind[1])
}

impl LeftOut {
    /// Creates a count of elements of this kind, in singular and plural, with the place of the
    /// first one.
    pub fn new(count: u64, kind: [&'static str; 2], first: impl Into<String>) -> LeftOut {
        LeftOut {
            count,
            kind: kind.map(Cow::Borrowed),
            first: first.into(),
        }
    }

    /// Adds the elements of another frame of the same run: for each kind, the frame with most of
    /// them counts. Returns true if a kind is new.
    pub fn merge(known: &mut Vec<LeftOut>, found: &[LeftOut]) -> bool {
        let before = known.len();
        for new in found {
            match known.iter_mut().find(|k| k.kind == new.kind) {
                Some(known) if known.count < new.count => *known = new.clone(),
                Some(_) => {}
                None => known.push(new.clone()),
            }
        }
        known.len() > before
    }

    /// Returns all kinds as text: `not read, so not verified: 2 surfaces (the first one: line
    /// 12)`.
    pub fn sentence(all: &[LeftOut]) -> String {
        let all: Vec<String> = all.iter().map(LeftOut::to_string).collect();
        format!("not read, so not verified: {}", all.join(", "))
    }

    /// Counts an element, whose place is needed if it is the first one of its kind.
    pub(crate) fn add(
        list: &mut Vec<LeftOut>,
        kind: [&'static str; 2],
        first: impl FnOnce() -> String,
    ) {
        LeftOut::add_all(list, kind, 1, first);
    }

    /// Counts elements of a kind.
    pub(crate) fn add_all(
        list: &mut Vec<LeftOut>,
        kind: [&'static str; 2],
        count: u64,
        first: impl FnOnce() -> String,
    ) {
        match list.iter_mut().find(|found| found.kind == kind) {
            Some(found) => found.count += count,
            None if count == 0 => {}
            None => list.push(LeftOut::new(count, kind, first())),
        }
    }
}

impl fmt::Display for LeftOut {
    /// Names the count, the kind and the first place: `2 surfaces (the first one: line 12)`.
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        let LeftOut { count, kind, first } = self;
        match count {
            1 => write!(f, "1 {} ({first})", kind[0]),
            _ => write!(f, "{count} {} (the first one: {first})", kind[1]),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn elements_that_were_not_read_are_counted_once_a_run() {
        let left_out = |count, kind, line: u32| LeftOut::new(count, kind, format!("line {line}"));
        let (surface, patch) = (["surface", "surfaces"], ["patch", "patches"]);
        let mut known = Vec::new();
        assert!(LeftOut::merge(&mut known, &[left_out(1, surface, 12)]));
        assert!(!LeftOut::merge(&mut known, &[left_out(3, surface, 7)]));
        assert!(!LeftOut::merge(&mut known, &[left_out(2, surface, 9)]));
        assert!(LeftOut::merge(&mut known, &[left_out(1, patch, 5)]));
        assert_eq!(
            LeftOut::sentence(&known),
            "not read, so not verified: 3 surfaces (the first one: line 7), 1 patch (line 5)"
        );
        let json = serde_json::to_value(&known[0]).unwrap();
        let expected = serde_json::json!({ "count": 3, "kind": "surfaces", "first": "line 7" });
        assert_eq!(json, expected);
    }
}
