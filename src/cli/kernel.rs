//! The option `--kernel` of `linkwatch certify`.

use super::number::{number, one_or_more, positive};
use super::settings::{parsed, split};
use linkwatch::kernels::{Accuracy, Method};

/// A kernel and its accuracy.
#[derive(Clone, Copy, Debug)]
pub struct Kernel {
    pub method: Method,
    pub accuracy: Accuracy,
}

/// Parses the name of a kernel, and its settings.
pub fn kernel(text: &str) -> Result<Kernel, String> {
    let (name, settings) = split(text, &["beta", "target", "order"])?;
    let method: Method = name.parse().map_err(|e| format!("{e}"))?;
    for (key, _) in &settings {
        let of = match *key {
            "order" => Method::Fmm,
            _ => Method::BarnesHut,
        };
        if method != of {
            return Err(format!("{key} is a setting of {of}, not of {method}"));
        }
    }
    let accuracy = Accuracy {
        beta: parsed(&settings, "beta", one_or_more)?,
        target: parsed(&settings, "target", positive)?,
        order: parsed(&settings, "order", order)?,
        ..Accuracy::default()
    };
    match (accuracy.target, accuracy.beta) {
        (Some(_), None) => Err("target needs beta".into()),
        _ => Ok(Kernel { method, accuracy }),
    }
}

/// Parses the order of the fast multipole method.
fn order(text: &str) -> Result<u32, String> {
    number(text, "a whole number from 2 to 20", |order| {
        (2..=20).contains(order)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn settings_belong_to_their_kernel() {
        let found = kernel("barnes-hut,beta=2,target=0.01").unwrap();
        assert_eq!(found.method, Method::BarnesHut);
        assert_eq!(
            (found.accuracy.beta, found.accuracy.target),
            (Some(2.0), Some(0.01))
        );
        assert_eq!(kernel("fmm,order=3").unwrap().accuracy.order, Some(3));
        for (bad, word) in [
            (
                "auto,beta=2",
                "beta is a setting of barnes-hut, not of auto",
            ),
            ("fmm,beta=2", "not of fmm"),
            ("direct,order=3", "order is a setting of fmm"),
            ("fmm,order=1", "from 2 to 20"),
            ("barnes-hut,beta=0.5", "at least 1"),
            ("barnes-hut,target=0.1", "target needs beta"),
            ("guess", "expected auto, crossings"),
        ] {
            let error = kernel(bad).unwrap_err();
            assert!(error.contains(word), "{bad}: {error}");
        }
    }
}
