//! Messages of a recording: `schemas/linkwatch.proto`, which describes their fields.

use crate::formats::container::protobuf::protobuf;
use prost::bytes::Bytes;

protobuf! {
    CurveFrame {
        1 seq: u64, (uint64);
        2 time: f64, (double);
        3 basis: i32, (int32);
        4 precision: i32, (int32);
        5 counts: Vec<i32>, (sint32, repeated);
        6 positions: Bytes, (bytes = "bytes");
        7 cuts: u32, (uint32);
        8 layout: u32, (uint32);
        9 time_step: f64, (double);
        10 cell: Vec<f64>, (double, repeated);
        11 baseline: u64, (uint64);
        12 left_out: Vec<LeftOut>, (message, repeated);
    }

    LeftOut {
        1 count: u64, (uint64);
        2 one: String, (string);
        3 several: String, (string);
        4 first: String, (string);
    }

    Labels {
        1 names: Vec<String>, (string, repeated);
        2 radii: Vec<f32>, (float, repeated);
    }

    Verdict {
        1 report: Option<Report>, (message, optional);
        2 progress: Option<Progress>, (message, optional);
    }

    Report {
        1 seq: u64, (uint64);
        2 time: f64, (double);
        3 verdict: i32, (int32);
        4 abort: bool, (bool);
        5 changes: Vec<Change>, (message, repeated);
        6 defects: Vec<Defect>, (message, repeated);
        7 rejected: Option<String>, (string, optional);
        8 stats: Option<Stats>, (message, optional);
        9 events: Vec<PullThrough>, (message, repeated);
        10 adopted: Vec<Link>, (message, repeated);
        11 unresolved: Vec<PullThrough>, (message, repeated);
        12 last_intact: Option<u64>, (uint64, optional);
        13 safe_fraction: Option<f64>, (double, optional);
        14 appeared: Vec<String>, (string, repeated);
        15 gone: Vec<String>, (string, repeated);
        16 missing: Vec<String>, (string, repeated);
        17 clearance: Option<Clearance>, (message, optional);
        18 left_out: Vec<LeftOut>, (message, repeated);
    }

    Clearance {
        1 at_least: f64, (double);
        2 closest: Option<CloseStrands>, (message, optional);
        3 low: bool, (bool);
        4 frames_left: Option<f64>, (double, optional);
    }

    CloseStrands {
        1 i: u32, (uint32);
        2 j: u32, (uint32);
        3 segment_i: u32, (uint32);
        4 segment_j: u32, (uint32);
        5 x_i: f64, (double);
        6 y_i: f64, (double);
        7 z_i: f64, (double);
        8 x_j: f64, (double);
        9 y_j: f64, (double);
        10 z_j: f64, (double);
        11 distance: f64, (double);
        12 ratio: f64, (double);
        13 error: f64, (double);
        14 image: Vec<i32>, (sint32, repeated);
    }

    #[derive(Copy)]
    Progress {
        1 verified: u64, (uint64);
        2 skipped: u64, (uint64);
        3 rejected: u64, (uint64);
        4 check_ns: u64, (uint64);
        5 work: Option<Work>, (message, optional);
        6 times: Option<FrameTimes>, (message, optional);
        7 left_out: u64, (uint64);
        8 recovered: u32, (uint32);
        9 accepted: u32, (uint32);
    }

    #[derive(Copy)]
    FrameTimes {
        1 ingest_ns: u64, (uint64);
        2 verification_ns: u64, (uint64);
        3 live: Option<LiveTimes>, (message, optional);
    }

    #[derive(Copy)]
    LiveTimes {
        1 interval_ns: u64, (uint64);
        2 wait_ns: u64, (uint64);
        3 send_ns: u64, (uint64);
    }

    #[derive(Copy)]
    Work {
        1 route: i32, (int32);
        2 blocks: u64, (uint64);
        3 marked: u64, (uint64);
        4 recertified: u64, (uint64);
        5 recomputed: u64, (uint64);
        6 searched: u64, (uint64);
        7 reference_age: Option<u64>, (uint64, optional);
        8 disagreed: bool, (bool);
        9 summed: u64, (uint64);
    }

    Change {
        1 i: u32, (uint32);
        2 j: u32, (uint32);
        3 expected: i64, (sint64);
        4 found: i64, (sint64);
        5 place: Option<Place>, (message, optional);
        6 image: Vec<i32>, (sint32, repeated);
    }

    PullThrough {
        1 i: u32, (uint32);
        2 j: u32, (uint32);
        3 segment_i: u32, (uint32);
        4 segment_j: u32, (uint32);
        5 fraction: f64, (double);
        6 sign: i32, (sint32);
        7 x: f64, (double);
        8 y: f64, (double);
        9 z: f64, (double);
        10 lengths: f64, (double);
        11 image: Vec<i32>, (sint32, repeated);
    }

    Defect {
        1 i: u32, (uint32);
        2 j: Option<u32>, (uint32, optional);
        3 kind: i32, (int32);
        4 place: Option<Place>, (message, optional);
        5 image: Vec<i32>, (sint32, repeated);
    }

    #[derive(Copy)]
    Place {
        1 segment_i: u32, (uint32);
        2 segment_j: u32, (uint32);
        3 x: f64, (double);
        4 y: f64, (double);
        5 z: f64, (double);
        6 distance: f64, (double);
    }

    #[derive(Copy)]
    Stats {
        1 curves: u64, (uint64);
        2 segments: u64, (uint64);
        3 open_curves: u64, (uint64);
        4 repeated_vertices: u64, (uint64);
        5 potential_links: u64, (uint64);
        6 separated: u64, (uint64);
        7 tests: u64, (uint64);
        8 crossings: u64, (uint64);
        9 overlaps: u64, (uint64);
        10 refined: u64, (uint64);
        11 exact: u64, (uint64);
        12 unchecked: u64, (uint64);
        13 extent: f64, (double);
    }

    Baseline {
        1 curves: u64, (uint64);
        2 links: Vec<Link>, (message, repeated);
        3 undefined: Vec<Defect>, (message, repeated);
        4 origin: String, (string);
        5 periodic: bool, (bool);
        6 images: Vec<ImageLink>, (message, repeated);
        7 periods: Vec<YarnPeriod>, (message, repeated);
        8 frame: Option<u64>, (uint64, optional);
        9 unverified: u64, (uint64);
    }

    YarnPeriod {
        1 curve: u32, (uint32);
        2 period: Vec<i32>, (sint32, repeated);
    }

    ImageLink {
        1 i: u32, (uint32);
        2 j: u32, (uint32);
        3 image: Vec<i32>, (sint32, repeated);
        4 lambda: Option<i64>, (sint64, optional);
    }

    #[derive(Copy)]
    Link {
        1 i: u32, (uint32);
        2 j: u32, (uint32);
        3 lambda: i64, (sint64);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::formats::container::protobuf::tests::differences;

    #[test]
    fn the_fields_have_the_names_numbers_and_types_of_the_schema() {
        macro_rules! check {
            ($($message:ident),*) => {$(
                let schemas = crate::record::messages::DESCRIPTORS;
                let only = differences(schemas, stringify!($message), $message::FIELDS);
                assert!(only.iter().all(Vec::is_empty), "{}: {only:?}", stringify!($message));
            )*};
        }
        check!(
            CurveFrame,
            Labels,
            Verdict,
            Report,
            Clearance,
            CloseStrands,
            Progress,
            FrameTimes,
            LiveTimes,
            Work,
            Change,
            PullThrough,
            Defect,
            Place,
            Stats,
            Baseline,
            YarnPeriod,
            ImageLink,
            Link
        );
    }
}
