//! `foxglove.SceneUpdate`, in protobuf and JSON.

use super::curves::{self, Pose};
use super::state::{self, CYLINDER, Change, Entity, TRIANGLES, Update};
use crate::formats::container::foxglove::{LineType, SceneUpdate, Time};
use prost::Message;

/// Reads a message in protobuf.
pub(super) fn protobuf(message: &[u8]) -> Result<Update, String> {
    changes(SceneUpdate::decode(message).map_err(|e| e.to_string())?)
}

/// Reads a message in JSON.
pub(super) fn json(message: &[u8]) -> Result<Update, String> {
    let update = serde_json::from_slice(message);
    changes(update.map_err(|e| format!("not a scene update in JSON: {e}"))?)
}

fn changes(update: SceneUpdate) -> Result<Update, String> {
    let stamps = update.entities.iter().map(|e| nanoseconds(e.timestamp));
    let stamp = stamps.max().filter(|&ns| ns > 0);
    let mut changes = Vec::new();
    for deletion in update.deletions {
        changes.push(match deletion.r#type {
            0 => Change::Delete(name_of(deletion.id)),
            1 => Change::DeleteAll(None),
            other => return Err(format!("a deletion of type {other}, expected 0 or 1")),
        });
    }
    for entity in update.entities {
        let name = name_of(entity.id);
        let mut strips = Vec::new();
        for line in entity.lines {
            let kind = LineType::try_from(line.r#type).map_err(|_| {
                format!("{name:?}: a line of type {}, expected 0 to 2", line.r#type)
            })?;
            let points = line.points.into_iter().map(Into::into).collect();
            let pose = line.pose.unwrap_or_default();
            let turn = pose.orientation.unwrap_or_default();
            let position = pose.position.unwrap_or_default().into();
            let rotation = [turn.x, turn.y, turn.z, turn.w];
            let pose = Pose { position, rotation };
            let found = curves::strips(kind, points, &line.indices, &pose);
            strips.extend(found.map_err(|what| format!("{name:?}: {what}"))?);
        }
        let others: [(state::Kind, usize); 7] = [
            (["arrow", "arrows"], entity.arrows.len()),
            (["cube", "cubes"], entity.cubes.len()),
            (["sphere", "spheres"], entity.spheres.len()),
            (CYLINDER, entity.cylinders.len()),
            (TRIANGLES, entity.triangles.len()),
            (["text", "texts"], entity.texts.len()),
            (["model", "models"], entity.models.len()),
        ];
        let others = others.into_iter().filter(|(_, count)| *count > 0);
        let entity = Entity {
            namespace: String::new(),
            frame_id: entity.frame_id,
            lifetime: nanoseconds(entity.lifetime),
            strips,
            others: others.map(|(kind, count)| (kind, count as u64)).collect(),
        };
        changes.push(Change::Put(name, entity));
    }
    Ok(Update { stamp, changes })
}

/// Returns the name of an entity. Programs with one entity often leave its id empty.
fn name_of(id: String) -> String {
    match id.is_empty() {
        true => "(without id)".into(),
        false => id,
    }
}

/// Returns 0 without a time, and for one before 1970.
fn nanoseconds(time: Option<Time>) -> u64 {
    let time = time.unwrap_or_default();
    let ns = time.seconds.saturating_mul(1_000_000_000);
    u64::try_from(ns.saturating_add(time.nanos.into())).unwrap_or(0)
}
