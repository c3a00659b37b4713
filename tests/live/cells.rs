//! Periodic cells of a live simulation.

use super::*;
use linkwatch::{Cell, RecordedItem, RecordingReader};

/// A cell that is sheared and then given in another basis of its lattice, as simulations do. The
/// recording must have the basis of the verifier, in which findings name images.
#[test]
fn recorded_cells_have_the_basis_in_which_findings_name_images() {
    let folder = TempDir::new().unwrap();
    let service = service("cell-basis");
    let recording = folder.path().join("run.mcap");
    let args = ["--record", recording.to_str().unwrap()];
    let watch = Watch::start(folder.path(), "watch", &service, &args);
    let mut sim = Client::open(&service, &ClientOptions::lockstep()).unwrap();
    sim.describe(Basis::Polyline, Precision::F32, &[-4, -4])
        .unwrap();
    assert!(sim.wait_for_watcher(PATIENCE).unwrap());
    for (frame, tilt) in [4.9, -4.9].into_iter().enumerate() {
        let mut cell = Cell::orthogonal([0.0; 3], [10.0; 3]);
        cell.vectors[1][0] = tilt;
        sim.set_cell(Some(cell)).unwrap();
        assert_eq!(step(&mut sim, frame as u64, 0.0), Verdict::Intact);
    }
    sim.finish().unwrap();
    let live = watch.end();
    assert_eq!(live.code, Some(0), "{}", live.stderr);
    let mut reader = RecordingReader::open(&recording).unwrap();
    let mut tilts = Vec::new();
    while let Some(item) = reader.next_item().unwrap() {
        if let RecordedItem::Frame(frame) = item {
            tilts.push(frame.info.cell.unwrap().vectors[1][0]);
        }
    }
    assert_eq!(tilts.len(), 2);
    assert!(
        (tilts[0] - 4.9).abs() < 1e-6 && (tilts[1] - 5.1).abs() < 1e-6,
        "{tilts:?}"
    );
}
