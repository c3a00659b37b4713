//! Values of an attribute over time.

use super::binary::{Binary, Rep};
use super::layer::{Attribute, Place, Value};
use super::text::Text;
use crate::error::Result;
use std::io::{Read, Seek};

/// The reader of a file of either form.
#[derive(Debug)]
pub(super) enum Values<R> {
    Binary(Binary<R>),
    Text(Text<R>),
}

impl<R: Read + Seek> Values<R> {
    fn read(&mut self, attribute: &Attribute, place: Place) -> Result<Value> {
        match self {
            Values::Binary(file) => file.value(Rep(place.0)),
            Values::Text(file) => file.value(attribute, place),
        }
    }
}

/// An attribute, and the value that was read last. A value that does not change is read once.
#[derive(Clone, Debug)]
pub(super) struct Track {
    pub attribute: Attribute,
    last: Option<(Place, Value)>,
}

impl Track {
    pub fn new(attribute: &Attribute) -> Track {
        Track {
            attribute: attribute.clone(),
            last: None,
        }
    }

    /// Returns true if the value may change.
    pub fn is_animated(&self) -> bool {
        !self.attribute.samples.is_empty()
    }

    /// Returns the value at a time: that of a sample; between two samples their linear
    /// interpolation, or the earlier value if they cannot be interpolated; before the first and
    /// after the last sample its value. Without samples it is the default value. `None` if there is
    /// no value.
    pub fn at<R: Read + Seek>(
        &mut self,
        time: f64,
        values: &mut Values<R>,
    ) -> Result<Option<&Value>> {
        let samples = &self.attribute.samples;
        let after = samples.partition_point(|s| s.0 <= time);
        let place = match (samples.is_empty(), after) {
            (true, _) => self.attribute.default,
            (false, 0) => Some(samples[0].1),
            (false, k) => Some(samples[k - 1].1),
        };
        let Some(place) = place else { return Ok(None) };
        let between = (after > 0 && after < samples.len())
            .then(|| (samples[after - 1].0, samples[after]))
            .filter(|(before, _)| *before < time);
        self.load(place, values)?;
        if let (Some((before, (after, next))), Some((_, value))) = (between, &self.last) {
            let next = values.read(&self.attribute, next)?;
            let share = (time - before) / (after - before);
            if let Some(mixed) = mix(value, &next, share) {
                // The interpolated value has no place, so it is not reused.
                self.last = Some((Place(u64::MAX), mixed));
            }
        }
        let last = self.last.as_ref().map(|(_, value)| value);
        Ok(last.filter(|value| **value != Value::Blocked))
    }

    /// Drops the value that was read last, if it may change: it is rarely needed again.
    pub fn forget(&mut self) {
        if self.is_animated() {
            self.last = None;
        }
    }

    fn load<R: Read + Seek>(&mut self, place: Place, values: &mut Values<R>) -> Result<()> {
        if self.last.as_ref().is_none_or(|(last, _)| *last != place) {
            self.last = None;
            self.last = Some((place, values.read(&self.attribute, place)?));
        }
        Ok(())
    }

    /// Passes all values to a function: the default one, or those of all samples.
    pub fn each<R: Read + Seek>(
        &self,
        values: &mut Values<R>,
        mut check: impl FnMut(Value) -> Result<()>,
    ) -> Result<()> {
        let places = self.attribute.samples.iter().map(|s| s.1);
        let default = self.attribute.default.filter(|_| !self.is_animated());
        for place in places.chain(default) {
            check(values.read(&self.attribute, place)?)?;
        }
        Ok(())
    }
}

/// Interpolates linearly; quaternions on the sphere. `None` if the values cannot be interpolated.
fn mix(a: &Value, b: &Value, share: f64) -> Option<Value> {
    let line = |a: f64, b: f64| (1.0 - share) * a + share * b;
    match (a, b) {
        (Value::Singles(4, a), Value::Singles(4, b)) => {
            let double = |v: &[f32]| v.iter().map(|&x| x.into()).collect::<Vec<f64>>();
            let mixed = slerp(&double(a), &double(b), share)?;
            Some(Value::Doubles(4, mixed))
        }
        (Value::Doubles(4, a), Value::Doubles(4, b)) => {
            slerp(a, b, share).map(|v| Value::Doubles(4, v))
        }
        (Value::Singles(n, a), Value::Singles(m, b)) if n == m && a.len() == b.len() => {
            let pairs = a.iter().zip(b);
            let mixed = pairs.map(|(&a, &b)| line(a.into(), b.into()) as f32);
            Some(Value::Singles(*n, mixed.collect()))
        }
        (Value::Doubles(n, a), Value::Doubles(m, b)) if n == m && a.len() == b.len() => {
            let pairs = a.iter().zip(b);
            Some(Value::Doubles(
                *n,
                pairs.map(|(&a, &b)| line(a, b)).collect(),
            ))
        }
        _ => None,
    }
}

/// Interpolates two quaternions on the sphere, along the shorter way.
fn slerp(a: &[f64], b: &[f64], share: f64) -> Option<Vec<f64>> {
    let (a, b) = (a.first_chunk::<4>()?, b.first_chunk::<4>()?);
    let cosine: f64 = a.iter().zip(b).map(|(a, b)| a * b).sum();
    let sign = cosine.signum();
    let angle = cosine.abs().min(1.0).acos();
    let [from, to] = match angle.sin() {
        sine if sine > 1e-5 => [
            ((1.0 - share) * angle).sin() / sine,
            (share * angle).sin() / sine,
        ],
        _ => [1.0 - share, share],
    };
    let mixed = a.iter().zip(b).map(|(a, b)| from * a + sign * to * b);
    Some(mixed.collect())
}
