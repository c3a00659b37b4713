use super::*;
use crate::verdict::AbortOn;
use crate::verifier::Verifier;

fn built(text: &str) -> Generated {
    text.parse::<Scene>().unwrap().build().unwrap()
}

/// Asserts that the kernel finds the linking numbers of the construction; returns the number of potential links.
fn verified(text: &str) -> u64 {
    let generated = built(text);
    let (found, stats) = Verifier::new(AbortOn::Never).certify(&generated.curves);
    // Not printed: there may be very many.
    assert!(found == generated.certificate, "{text}");
    assert_eq!(stats.open_curves, 0);
    stats.potential_links
}

#[test]
fn kernels_find_the_certificates_of_the_constructions() {
    for scene in [
        "ribbon",
        "chainmail",
        "chainmail:crumple=1",
        "rubber_bands",
        "knit",
        "square_link",
        "torus_link:segments=200000,toroidal=30,poloidal=-7",
        "torus_zero",
        "woundball",
    ] {
        let start = std::time::Instant::now();
        let p = verified(scene);
        eprintln!("{scene}: {p} {:?}", start.elapsed());
    }
}
