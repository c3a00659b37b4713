//! Values of options that carry settings: `FILE.mcap,every=10,max=1GB`.

/// Keys of settings with their values.
pub type Settings<'a> = Vec<(&'a str, &'a str)>;

/// Splits a value into what stands before its settings, and the settings. A comma that no setting
/// follows belongs to what stands before, so that names of files may have commas.
///
/// # Errors
///
/// Text about a setting that is not in `known`, or that is given twice.
pub fn split<'a>(value: &'a str, known: &[&str]) -> Result<(&'a str, Settings<'a>), String> {
    let (mut what, mut settings) = (value, Vec::new());
    while let Some((before, last)) = what.rsplit_once(',') {
        let (key, setting) = last.split_once('=').unwrap_or((last, ""));
        if !known.contains(&key) {
            let is_setting = last.contains('=') && key.bytes().all(|b| b.is_ascii_lowercase());
            if !is_setting {
                break;
            }
            let known = known.join(", ");
            return Err(format!("no setting '{key}': expected one of {known}"));
        }
        if setting.is_empty() {
            return Err(format!("{key} needs a value: {key}=.."));
        }
        if settings.iter().any(|(other, _)| *other == key) {
            return Err(format!("the setting '{key}' is given twice"));
        }
        settings.push((key, setting));
        what = before;
    }
    match what {
        "" => Err("expected a name before the settings".into()),
        what => Ok((what, settings)),
    }
}

/// Parses the value of a setting, if it is given. An error names the setting.
pub fn parsed<T>(
    settings: &Settings<'_>,
    key: &str,
    parse: impl FnOnce(&str) -> Result<T, String>,
) -> Result<Option<T>, String> {
    let given = settings.iter().find(|(known, _)| *known == key);
    let parsed = given.map(|(_, value)| parse(value)).transpose();
    parsed.map_err(|e| format!("{key}: {e}"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn settings_follow_a_name_that_may_have_commas() {
        let known = ["every", "max"];
        let split = |text| split(text, &known);
        assert_eq!(split("run.mcap"), Ok(("run.mcap", vec![])));
        assert_eq!(split("a,b.mcap"), Ok(("a,b.mcap", vec![])));
        let both = vec![("max", "1GB"), ("every", "10")];
        assert_eq!(split("a,b.mcap,every=10,max=1GB"), Ok(("a,b.mcap", both)));
        for (bad, word) in [
            ("run.mcap,evry=10", "no setting 'evry'"),
            ("run.mcap,every=1,every=2", "given twice"),
            ("run.mcap,every", "every needs a value"),
            ("run.mcap,max=1GB,every=", "every needs a value"),
            ("run.mcap,every,max=1GB", "every needs a value"),
            (",every=1", "expected a name"),
        ] {
            let error = split(bad).unwrap_err();
            assert!(error.contains(word), "{bad}: {error}");
        }
    }
}
