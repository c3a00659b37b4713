use super::*;
use crate::engine::Certifier;

fn scene(text: &str) -> Scene {
    text.parse().unwrap()
}

fn bytes(text: &str) -> Vec<u8> {
    let mut out = Vec::new();
    let curves = scene(text).build().unwrap().curves;
    curves.write_positions(&mut out);
    out
}

fn assert_error_contains<T: std::fmt::Debug>(result: Result<T>, expected: &str) {
    let message = result.unwrap_err().to_string();
    assert!(message.contains(expected), "{message:?} lacks {expected:?}");
}

/// Asserts that the kernel finds the linking numbers of the construction. Returns the number of
/// potential links.
fn verified(text: &str, generated: &Generated) -> u64 {
    let mut certifier = Certifier::default();
    let (found, stats) = certifier.certify(&generated.curves);
    // Not printed, because there may be very many links.
    assert!(*found == generated.certificate, "{text}");
    assert_eq!(stats.open_curves, 0, "{text}");
    stats.potential_links
}

/// Returns curves, segments, links and potential links of a scene that the kernel has verified.
fn sizes(text: &str) -> (usize, usize, usize, u64) {
    let g = scene(text).build().unwrap();
    let potential = verified(text, &g);
    let (curves, segments) = (g.curves.len(), g.curves.segments());
    (curves, segments, g.certificate.links.len(), potential)
}

/// Sizes of table 1 of Qu & James 2021, for the scenes of that table.
#[test]
fn the_defaults_have_their_sizes_and_their_certificates() {
    for (text, curves, segments, links, potential) in [
        ("chainmail", 14_112, 211_680, 18_676, 18_676..=18_676),
        (
            "chainmail:crumple=1",
            14_112,
            211_680,
            18_676,
            60_000..=65_000,
        ),
        ("knit", 250, 270_000, 0, 249..=249),
        ("ribbon", 2, 200_000, 1, 1..=1),
        ("ribbon:lambda=1000", 2, 200_000, 1, 1..=1),
        ("rubber_bands", 1024, 51_200, 0, 19_000..=22_000),
        ("square_link", 1250, 500_000, 390_625, 405_625..=405_625),
        (
            "torus_link:segments=2e5,toroidal=100,poloidal=100",
            2,
            200_000,
            1,
            1..=1,
        ),
        ("torus_zero", 4, 400_000, 0, 6..=6),
        ("woundball", 2, 1_000_000, 0, 1..=1),
    ] {
        let found = sizes(text);
        assert_eq!(
            (found.0, found.1, found.2),
            (curves, segments, links),
            "{text}"
        );
        assert!(potential.contains(&found.3), "{text}: {}", found.3);
    }
}

#[test]
fn kernels_find_the_linking_numbers_of_the_constructions() {
    for text in [
        "chainmail:rows=1,columns=1",
        "chainmail:rows=1,columns=5,crumple=0.5",
        "chainmail:rows=7,columns=3,crumple=1",
        "chainmail:rows=30,columns=30,crumple=0.8",
        "knit:rows=1,stitches=16,segments=128",
        "knit:rows=5,stitches=17,segments=1020,diameter=0.37",
        "ribbon:segments=1000,lambda=0",
        "ribbon:segments=1000,lambda=1",
        "ribbon:segments=1001,lambda=-1",
        "ribbon:segments=5000,lambda=-33",
        "rubber_bands:bands=1",
        "rubber_bands:bands=100,seed=2",
        "rubber_bands:bands=3000,seed=4294967295",
        "square_link:loops=2,segments=8",
        "square_link:loops=10,segments=97",
        "torus_link:segments=2000,toroidal=3,poloidal=5",
        "torus_link:segments=2001,toroidal=-3,poloidal=5",
        "torus_link:segments=2000,toroidal=3,poloidal=-5",
        "torus_link:segments=2000,toroidal=-4,poloidal=-1",
        "torus_link:segments=2000,toroidal=0,poloidal=7",
        "torus_link:segments=2000,toroidal=7,poloidal=0",
        "torus_zero:segments=2001,periods=2",
        "torus_zero:segments=20003,periods=10",
        "woundball:segments=100,crossings=1",
        "woundball:segments=3001,crossings=100",
    ] {
        sizes(text);
    }
}

/// All scenes that are accepted are correct, however coarse. A filter may reject too many scenes,
/// but never too few.
#[test]
fn the_coarsest_accepted_scenes_are_correct() {
    for (kind, rest) in [
        ("ribbon", "lambda=1"),
        ("ribbon", "lambda=-7"),
        ("torus_link", "toroidal=2,poloidal=3"),
        ("torus_zero", "periods=2"),
        ("woundball", "crossings=5"),
    ] {
        let mut accepted = 0;
        for segments in 12..2000 {
            let text = format!("{kind}:segments={segments},{rest}");
            match scene(&text).build() {
                Ok(generated) => {
                    verified(&text, &generated);
                    accepted += 1;
                }
                Err(e) => {
                    assert!(e.to_string().contains("take more segments"), "{e}");
                    assert_eq!(accepted, 0, "{text} is finer than one that was accepted");
                }
            }
            if accepted == 100 {
                break;
            }
        }
        assert_eq!(accepted, 100, "{kind}");
    }
}

#[test]
fn the_same_string_gives_the_same_bytes() {
    for text in [
        "rubber_bands:bands=50",
        "chainmail:rows=3,columns=3,crumple=1",
        "knit",
    ] {
        assert_eq!(bytes(text), bytes(text));
        // With every default spelled out.
        assert_eq!(bytes(text), bytes(&scene(text).to_string()));
    }
    assert_ne!(
        bytes("rubber_bands:bands=50,seed=1"),
        bytes("rubber_bands:bands=50,seed=2")
    );
}

#[test]
fn descriptions_round_trip() {
    for kind in &KINDS {
        let plain = scene(kind.name);
        assert_eq!(scene(&plain.to_string()), plain);
        for p in kind.parameters {
            assert_eq!(
                plain.value(p.name),
                Some(p.default),
                "{} {}",
                kind.name,
                p.name
            );
            for value in [p.min, p.max] {
                let text = format!("{}:{}={value}", kind.name, p.name);
                let scene = scene(&text);
                assert_eq!(scene.value(p.name), Some(value), "{text}");
                assert_eq!(scene.to_string().parse::<Scene>().unwrap(), scene);
            }
            for value in [p.min - 1.0, p.max + 1.0] {
                let text = format!("{}:{}={value}", kind.name, p.name);
                assert_error_contains(
                    text.parse::<Scene>(),
                    &format!("from {} to {}", p.min, p.max),
                );
            }
        }
    }
    let given = scene("ribbon:lambda=-1e3,segments=2e7");
    assert_eq!(given.to_string(), "ribbon:segments=20000000,lambda=-1000");
    assert_eq!(given.kind().name, "ribbon");
    assert_eq!(given.value("seed"), None);
}

#[test]
fn a_misspelt_name_suggests_the_nearest() {
    for (text, expected) in [
        ("knti", "woundball); the nearest is 'knit'"),
        ("Chainmial:rows=2", "; the nearest is 'chainmail'"),
        ("wound", "; the nearest is 'woundball'"),
        (
            "ribbon:segmnts=20",
            "(known: segments, lambda); the nearest is 'segments'",
        ),
    ] {
        assert_error_contains(text.parse::<Scene>(), expected);
    }
    assert_error_contains("smoth".parse::<Motion>(), "; the nearest is 'smooth'");
    let e = "rope".parse::<Scene>().unwrap_err().to_string();
    assert!(!e.contains("nearest"), "{e}");
}

#[test]
fn rejects_bad_descriptions_with_a_reason() {
    for (text, expected) in [
        ("", "unknown (known: chainmail, knit, ribbon"),
        ("rope", "scene rope: unknown (known: chainmail"),
        ("ribbon:", "'', expected key=value"),
        ("ribbon:lambda", "'lambda', expected key=value"),
        ("ribbon:lambda=1,", "'', expected key=value"),
        (
            "ribbon:lamda=1",
            "unknown parameter 'lamda' (known: segments, lambda)",
        ),
        ("ribbon:lambda=1,lambda=1", "lambda is given twice"),
        ("ribbon:lambda=", "lambda is ''; expected an integer"),
        ("ribbon:lambda=ten", "lambda is 'ten'; expected an integer"),
        ("ribbon:lambda=1.5", "lambda is '1.5'; expected an integer"),
        (
            "ribbon:lambda=nan",
            "expected an integer from -1000000 to 1000000",
        ),
        (
            "ribbon:segments=inf",
            "expected an integer from 6 to 2147483647",
        ),
        (
            "ribbon:segments=3e9",
            "expected an integer from 6 to 2147483647",
        ),
        (
            "chainmail:crumple=1.01",
            "crumple is '1.01'; expected a number from 0 to 1",
        ),
        ("\x1b[2J", "scene \\u{1b}[2J: unknown"),
    ] {
        assert_error_contains(text.parse::<Scene>(), expected);
    }
    let long = "x".repeat(10_000);
    assert!(long.parse::<Scene>().unwrap_err().to_string().len() < 250);
}

/// Some combinations of valid values are invalid.
#[test]
fn rejects_invalid_combinations_of_parameters() {
    for (text, expected) in [
        (
            "ribbon:lambda=1e6",
            "take more segments or a smaller lambda",
        ),
        ("ribbon:segments=6", "take more segments"),
        (
            "torus_link:segments=1000",
            "take more segments or fewer periods",
        ),
        ("torus_zero:periods=3", "odd number of periods"),
        (
            "torus_zero:periods=1e6",
            "take more segments or fewer periods",
        ),
        (
            "woundball:crossings=1e6",
            "take more segments or fewer crossings",
        ),
        ("square_link:loops=3", "even number of loops"),
        (
            "square_link:loops=4,segments=15",
            "4 squares need at least 16 segments",
        ),
        ("knit:rows=251", "multiple of rows * stitches = 22590"),
        ("knit:rows=2,stitches=16,segments=224", "8 times it or more"),
    ] {
        assert_error_contains(scene(text).build(), expected);
    }
}
