//! A strict reader of the text format of Prometheus, version 0.0.4.

use std::collections::{BTreeMap, BTreeSet};

/// Labels of a sample, by name.
pub type Labels = BTreeMap<String, String>;

/// A page of metrics that follows the format.
#[derive(Debug, Default)]
pub struct Page {
    /// Type of each family.
    pub types: BTreeMap<String, String>,
    samples: BTreeMap<(String, Labels), f64>,
}

impl Page {
    /// Returns the value of a sample, if the page has it.
    pub fn get(&self, name: &str, labels: &[(&str, &str)]) -> Option<f64> {
        let labels = labels.iter().map(|&(k, v)| (k.to_owned(), v.to_owned()));
        self.samples
            .get(&(name.to_owned(), labels.collect()))
            .copied()
    }

    /// Returns the samples of a name, with their labels.
    pub fn of<'a>(&'a self, name: &'a str) -> impl Iterator<Item = (&'a Labels, f64)> {
        let of = self.samples.iter().filter(move |((n, _), _)| n == name);
        of.map(|((_, labels), &value)| (labels, value))
    }
}

/// Reads a page. Holds every line to the format, and every family to the rules of its type.
pub fn parse(text: &str) -> Result<Page, String> {
    let mut page = Page::default();
    let mut open: Option<(String, String)> = None;
    let mut help: Option<String> = None;
    let body = text.strip_suffix('\n').ok_or("the last line has no end")?;
    for line in body.split('\n') {
        let wrong = |why: &str| Err(format!("{why}: {line:?}"));
        if let Some(rest) = line.strip_prefix("# HELP ") {
            let (name, words) = rest.split_once(' ').ok_or("a family without help")?;
            if !is_name(name, ":") || words.is_empty() || unescaped(words, "\\n").is_none() {
                return wrong("malformed help");
            }
            if help.replace(name.to_owned()).is_some() {
                return wrong("help without a type before it");
            }
        } else if let Some(rest) = line.strip_prefix("# TYPE ") {
            let (name, kind) = rest.split_once(' ').ok_or("a family without a type")?;
            if help.take().as_deref() != Some(name) {
                return wrong("type without its help");
            }
            if !matches!(kind, "counter" | "gauge" | "histogram") {
                return wrong("unexpected type");
            }
            if (kind == "counter") != name.ends_with("_total") {
                return wrong("a counter, and nothing else, ends in _total");
            }
            if page
                .types
                .insert(name.to_owned(), kind.to_owned())
                .is_some()
            {
                return wrong("a family twice");
            }
            open = Some((name.to_owned(), kind.to_owned()));
        } else {
            let (name, labels, value) = sample(line).ok_or(format!("malformed: {line:?}"))?;
            let Some((family, kind)) = open.as_ref().filter(|_| help.is_none()) else {
                return wrong("a sample without a family");
            };
            let part = name.strip_prefix(family.as_str());
            let fits = match kind.as_str() {
                "histogram" => matches!(part, Some("_bucket" | "_sum" | "_count")),
                _ => part == Some(""),
            };
            if !fits {
                return wrong("a sample of another family");
            }
            let whole = value >= 0.0 && value.fract() == 0.0;
            if !whole && (kind == "counter" || matches!(part, Some("_bucket" | "_count"))) {
                return wrong("a count that is not a whole number");
            }
            if page.samples.insert((name, labels), value).is_some() {
                return wrong("a sample twice");
            }
        }
    }
    for (family, kind) in &page.types {
        match kind.as_str() {
            "histogram" => check_histograms(&page, family)?,
            _ if page.of(family).next().is_none() => {
                return Err(format!("{family} has no samples"));
            }
            _ => {}
        }
    }
    Ok(page)
}

/// Checks that the buckets of each histogram are cumulative, and agree with its count.
fn check_histograms(page: &Page, family: &str) -> Result<(), String> {
    let mut buckets: BTreeMap<Labels, Vec<(f64, f64)>> = BTreeMap::new();
    for (labels, value) in page.of(&format!("{family}_bucket")) {
        let mut labels = labels.clone();
        let bound = labels.remove("le").ok_or(format!("{family}: no bound"))?;
        let bound = number(&bound).ok_or(format!("{family}: bound {bound}"))?;
        buckets.entry(labels).or_default().push((bound, value));
    }
    let rest: Vec<BTreeSet<Labels>> = ["_sum", "_count"]
        .map(|part| {
            page.of(&format!("{family}{part}"))
                .map(|(l, _)| l.clone())
                .collect()
        })
        .into();
    let keys: BTreeSet<Labels> = buckets.keys().cloned().collect();
    if keys.is_empty() || rest.iter().any(|part| *part != keys) {
        return Err(format!("{family}: buckets, sum or count are missing"));
    }
    for (labels, mut buckets) in buckets {
        buckets.sort_by(|a, b| a.0.total_cmp(&b.0));
        let rises = buckets
            .windows(2)
            .all(|w| w[0].0 < w[1].0 && w[0].1 <= w[1].1);
        let count = page.samples[&(format!("{family}_count"), labels.clone())];
        if !rises || buckets.last() != Some(&(f64::INFINITY, count)) {
            return Err(format!(
                "{family}: {labels:?}: buckets {buckets:?}, count {count}"
            ));
        }
    }
    Ok(())
}

/// Splits a sample into name, labels and value. There are no time stamps.
fn sample(line: &str) -> Option<(String, Labels, f64)> {
    let (head, value) = line.rsplit_once(' ')?;
    let value = number(value)?;
    let (name, mut rest) = match head.split_once('{') {
        Some((name, rest)) => (name, rest.strip_suffix('}')?),
        None => (head, ""),
    };
    let mut labels = Labels::new();
    while !rest.is_empty() {
        let (label, text) = rest.split_once("=\"")?;
        let mut end = 0;
        while text.as_bytes().get(end)? != &b'"' {
            end += if text.as_bytes()[end] == b'\\' { 2 } else { 1 };
        }
        let value = unescaped(text.get(..end)?, "\\n\"")?;
        if !is_name(label, "") || labels.insert(label.to_owned(), value).is_some() {
            return None;
        }
        rest = match &text[end + 1..] {
            "" => "",
            more => more.strip_prefix(',').filter(|more| !more.is_empty())?,
        };
    }
    is_name(name, ":").then(|| (name.to_owned(), labels, value))
}

/// Returns true if the name of a metric or label is valid. `more` are further characters.
fn is_name(name: &str, more: &str) -> bool {
    let valid = |c: char| c.is_ascii_alphanumeric() || c == '_' || more.contains(c);
    !name.is_empty() && !name.starts_with(|c: char| c.is_ascii_digit()) && name.chars().all(valid)
}

/// Replaces a backslash and one of these characters. Returns `None` if a backslash is followed by
/// another one, or if a character that needs a backslash has none.
fn unescaped(text: &str, after: &str) -> Option<String> {
    let mut chars = text.chars();
    let mut plain = String::new();
    while let Some(c) = chars.next() {
        plain.push(match c {
            '\\' => match chars.next().filter(|&next| after.contains(next))? {
                'n' => '\n',
                other => other,
            },
            '"' if after.contains('"') => return None,
            c => c,
        });
    }
    Some(plain)
}

fn number(text: &str) -> Option<f64> {
    match text {
        "+Inf" => Some(f64::INFINITY),
        _ if text
            .bytes()
            .all(|b| b.is_ascii_digit() || b"+-.e".contains(&b)) =>
        {
            text.parse().ok()
        }
        _ => None,
    }
}

#[test]
fn the_reader_accepts_valid_pages_and_rejects_others() {
    let valid = "# HELP a_total A \\\\ b.\n# TYPE a_total counter\na_total{s=\"x\\\"\\\\n, }\"} 3\n\
                 a_total{s=\"y\",t=\"\"} 0\n# HELP h H.\n# TYPE h histogram\n\
                 h_bucket{le=\"0.1\"} 1\nh_bucket{le=\"+Inf\"} 2\nh_sum 1.5e-3\nh_count 2\n";
    let page = parse(valid).unwrap();
    assert_eq!(page.get("a_total", &[("s", "x\"\\n, }")]), Some(3.0));
    assert_eq!(page.get("h_sum", &[]), Some(1.5e-3));
    for (part, other) in [
        ("a_total{s=\"y\",t=\"\"} 0\n", "a_total{s=\"y\",t=\"\"} 0"),
        ("h_count 2\n", "h_count 2"),
        ("h_count 2\n", "h_count 3\n"),
        ("h_count 2\n", ""),
        ("h_sum 1.5e-3\n", ""),
        ("h_bucket{le=\"+Inf\"} 2\n", ""),
        ("h_bucket{le=\"0.1\"} 1", "h_bucket{le=\"0.1\"} 3"),
        ("h_bucket{le=\"0.1\"} 1", "h_bucket 1"),
        ("# HELP h H.\n", ""),
        ("# TYPE h histogram\n", ""),
        ("# TYPE h histogram", "# TYPE h summary"),
        ("# TYPE h histogram", "# TYPE h counter"),
        ("# HELP h H.", "# HELP h"),
        ("# HELP h H.", "# HELP h H\\x"),
        ("# HELP h H.", "# HELP g H."),
        ("# HELP h H.", "#HELP h H."),
        ("# HELP h H.", "\n# HELP h H."),
        ("a_total{s=\"y\",t=\"\"} 0", "a_total{s=\"y\",s=\"\"} 0"),
        ("a_total{s=\"y\",t=\"\"} 0", "a_total{s=\"y\",} 0"),
        ("a_total{s=\"y\",t=\"\"} 0", "a_total{s=\"y\",t=\"\"} 0.5"),
        ("a_total{s=\"y\",t=\"\"} 0", "a_total{s=\"y\",t=\"\"} -1"),
        ("a_total{s=\"y\",t=\"\"} 0", "a_total{s=\"y\",t=\"\"} inf"),
        ("a_total{s=\"y\",t=\"\"} 0", "a_total{s=\"y\",t=\"\"}"),
        ("a_total{s=\"y\",t=\"\"} 0", "a_total{s=\"y\"t=\"\"} 0"),
        ("a_total{s=\"y\",t=\"\"} 0", "a_total{s=\"y\\t\"} 0"),
        ("a_total{s=\"y\",t=\"\"} 0", "a_total{s=y} 0"),
        (
            "a_total{s=\"y\",t=\"\"} 0",
            "a_total{s=\"x\\\"\\\\n, }\"} 0",
        ),
        ("a_total{s=\"y\",t=\"\"} 0", "b_total 0"),
        ("a_total{s=\"y\",t=\"\"} 0", "1a 0"),
    ] {
        assert_eq!(valid.matches(part).count(), 1, "{part:?}");
        let page = valid.replace(part, other);
        assert!(parse(&page).is_err(), "{page}");
    }
}
