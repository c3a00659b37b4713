//! Label of the results of one run, if a command has several at the same time or in succession.

use super::output;
use serde_json::Value;
use std::fmt;
use std::sync::Arc;

/// Service and session that results belong to. Empty if the command has only one run.
#[derive(Clone, Debug, Default)]
pub struct Label {
    /// Set if the command follows several services.
    pub service: Option<Arc<str>>,
    /// Set if the command follows several sessions of a service. The first one is 1.
    pub session: Option<u64>,
}

impl fmt::Display for Label {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match (&self.service, self.session) {
            (None, None) => Ok(()),
            (Some(service), None) => write!(f, "{service}: "),
            (None, Some(session)) => write!(f, "session {session}: "),
            (Some(service), Some(session)) => write!(f, "{service}, session {session}: "),
        }
    }
}

impl Label {
    /// Writes a line, or several, to stdout, each with this label.
    pub fn line(&self, text: impl fmt::Display) {
        match self.to_string() {
            label if label.is_empty() => output::line(text),
            label => {
                let text = text.to_string();
                let lines: Vec<String> = text.lines().map(|l| format!("{label}{l}")).collect();
                output::line(lines.join("\n"));
            }
        }
    }

    /// Writes an object as one line of JSON to stdout, with this label.
    pub fn json(&self, mut object: Value) {
        if let Some(service) = &self.service {
            object["service"] = Value::from(&**service);
        }
        if let Some(session) = self.session {
            object["session"] = session.into();
        }
        output::json(&object);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_label_names_the_service_and_the_session() {
        let label = |service: Option<&str>, session| Label {
            service: service.map(Arc::from),
            session,
        };
        assert_eq!(label(None, None).to_string(), "");
        assert_eq!(label(Some("A"), None).to_string(), "A: ");
        assert_eq!(label(None, Some(2)).to_string(), "session 2: ");
        assert_eq!(label(Some("A"), Some(2)).to_string(), "A, session 2: ");
    }
}
