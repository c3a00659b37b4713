//! The curves as a cloud of points with colours: `foxglove.PointCloud`.

use super::sample::{Limits, Sample};
use super::scene::pose;
use super::{FRAME_ID, State, states, time_of};
use crate::curve::CurveSet;
use crate::formats::container::foxglove::{NumericType, PackedElementField, PointCloud};
use crate::verdict::Report;
use prost::bytes::Bytes;

/// Curves of a small scene get points between their vertices, because a square of four points is
/// not seen.
const LIMITS: Limits = Limits {
    most: 250_000,
    wanted: 4000,
    per_segment: 16,
    per_edge: 16,
};

/// Bytes of a point: three coordinates in single precision, and a colour.
const STRIDE: usize = 16;

/// Writes clouds of points.
#[derive(Default)]
pub(crate) struct Points {
    /// Reused for every frame.
    data: Vec<u8>,
}

impl Points {
    /// Returns the message of a frame.
    pub fn message(&mut self, set: &CurveSet, report: &Report) -> PointCloud {
        let states = states(report, set.len());
        let rest = Sample::new(set, &states, |s| s == State::Intact, LIMITS);
        let found = Sample::new(set, &states, |s| s != State::Intact, LIMITS);
        let mut data = std::mem::take(&mut self.data);
        data.clear();
        for (i, &state) in states.iter().enumerate() {
            let sample = if state == State::Intact {
                &rest
            } else {
                &found
            };
            let color = state.color();
            for point in sample.points(i) {
                let [x, y, z] = point.map(|x| (x as f32).to_le_bytes());
                data.extend_from_slice([x, y, z, color].as_flattened());
            }
        }
        let coordinates = ["x", "y", "z"].map(|name| (name, NumericType::Float32));
        let colors = ["red", "green", "blue", "alpha"].map(|name| (name, NumericType::Uint8));
        let offsets = [0, 4, 8, 12, 13, 14, 15];
        let fields = coordinates.into_iter().chain(colors).zip(offsets);
        PointCloud {
            timestamp: Some(time_of(report)),
            frame_id: FRAME_ID.into(),
            pose: Some(pose([0.0; 3])),
            point_stride: STRIDE as u32,
            fields: fields
                .map(|((name, kind), offset)| PackedElementField {
                    name: name.into(),
                    offset,
                    r#type: kind.into(),
                })
                .collect(),
            data: Bytes::from(data),
        }
    }

    /// Takes the buffer of a message back. The message was its only owner, so nothing is copied.
    pub fn reuse(&mut self, message: PointCloud) {
        self.data = message.data.into();
    }
}
