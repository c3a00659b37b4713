//! Text USD files (`.usda`): prims and attributes are found when the file is opened, values are
//! read when they are needed.
//!
//! The grammar is that of the "Usda" chapter of the AOUSD core specification. Values, metadata and
//! relationships that curves do not need are skipped bracket by bracket, so that this reader never
//! recurses.

use super::input::Input;
use super::layer::{
    ATTRIBUTES, Attribute, Kind, Layer, Place, Prim, Samples, Value, arc, check_times,
};
use super::scanner::Scanner;
use crate::error::Result;
use std::io::{Read, Seek};

/// First bytes of a file. The version follows.
pub(super) const MAGIC: &[u8] = b"#usda";

/// An open file.
#[derive(Debug)]
pub(super) struct Text<R>(Scanner<R>);

impl<R: Read + Seek> Text<R> {
    /// Finds the prims of the file, and the places of values that curves need.
    pub fn open(input: Input<R>) -> Result<(Text<R>, Layer)> {
        let mut text = Text(Scanner::new(input));
        let layer = text.layer()?;
        Ok((text, layer))
    }

    fn layer(&mut self) -> Result<Layer> {
        let mut layer = Layer::default();
        if self.0.take(b'(')? {
            self.metadata(|text, key, adds| {
                match key {
                    "timeCodesPerSecond" => layer.time_codes_per_second = Some(text.time()?),
                    "framesPerSecond" => layer.frames_per_second = Some(text.time()?),
                    _ => {
                        let arc = arc(key).filter(|_| adds);
                        let filled = text.skip_metadata(arc.is_some())?;
                        layer.arc = layer.arc.or(arc.filter(|_| filled));
                    }
                }
                Ok(())
            })?;
        }
        // Prims whose content goes on.
        let mut open: Vec<usize> = Vec::new();
        loop {
            while self.0.take(b';')? {}
            match self.0.peek()? {
                None if open.is_empty() => return Ok(layer),
                None => {
                    let path = layer.path(open[open.len() - 1]);
                    return Err(self.0.bad(format_args!("the file ends inside of {path}")));
                }
                Some(b'}') if open.pop().is_some() => {
                    self.0.next()?;
                }
                Some(_) => {
                    let parent = open.last().copied();
                    let word = self.0.word()?;
                    match (word.as_str(), parent) {
                        ("def" | "over" | "class", _) => {
                            let prim = self.prim(&word, parent)?;
                            open.push(layer.prims.len());
                            layer.prims.push(prim);
                        }
                        ("reorder", _) => {
                            self.0.word()?;
                            self.0.expect(b'=')?;
                            self.0.skip_value()?;
                        }
                        ("variantSet", Some(parent)) => {
                            self.0.string()?;
                            self.0.expect(b'=')?;
                            self.0.skip_value()?;
                            layer.prims[parent].arc = Some("variants");
                        }
                        (_, Some(parent)) => self.property(word, &mut layer.prims[parent])?,
                        (_, None) => {
                            let what = format!("{word:?}, expected def, over or class");
                            return Err(self.0.bad(what));
                        }
                    }
                }
            }
        }
    }

    /// Reads a prim up to its content.
    fn prim(&mut self, specifier: &str, parent: Option<usize>) -> Result<Prim> {
        let mut prim = Prim {
            parent,
            defined: specifier == "def",
            ..Prim::default()
        };
        self.0.space()?;
        if !matches!(self.0.peek()?, Some(b'"' | b'\'')) {
            prim.kind = self.0.word()?;
        }
        prim.name = self.0.string()?;
        if self.0.take(b'(')? {
            self.metadata(|text, key, adds| {
                if key == "active" {
                    let value = text.0.word()?;
                    prim.inactive = matches!(value.as_str(), "false" | "False" | "0");
                    return Ok(());
                }
                let arc = arc(key).filter(|_| adds);
                let filled = text.skip_metadata(arc.is_some())?;
                prim.arc = prim.arc.or(arc.filter(|_| filled));
                Ok(())
            })?;
        }
        self.0.expect(b'{')?;
        Ok(prim)
    }

    /// Reads metadata after their opening parenthesis, and passes names to a function that reads
    /// the values. It is told false if the statement removes or sorts elements of a list.
    fn metadata(
        &mut self,
        mut each: impl FnMut(&mut Self, &str, bool) -> Result<()>,
    ) -> Result<()> {
        loop {
            while self.0.take(b';')? || self.0.take(b',')? {}
            match self.0.peek()? {
                Some(b')') => {
                    self.0.next()?;
                    return Ok(());
                }
                // Documentation.
                Some(b'"' | b'\'') => {
                    self.0.string()?;
                    continue;
                }
                _ => {}
            }
            let mut key = self.0.word()?;
            let mut adds = true;
            if matches!(
                key.as_str(),
                "add" | "append" | "prepend" | "delete" | "reorder"
            ) {
                adds = !matches!(key.as_str(), "delete" | "reorder");
                key = self.0.word()?;
            }
            self.0.expect(b'=')?;
            each(self, &key, adds)?;
        }
    }

    /// Skips the value of metadata. Returns false if it is `None` or an empty list.
    fn skip_metadata(&mut self, is_arc: bool) -> Result<bool> {
        let start = self.0.position();
        self.0.skip_value()?;
        if !is_arc {
            return Ok(true);
        }
        // A time offset of a reference.
        self.0.space()?;
        if self.0.peek()? == Some(b'(') {
            self.0.skip_value()?;
        }
        let end = self.0.position();
        self.0.seek(start);
        self.0.space()?;
        let empty = match self.0.peek()? {
            Some(b'[') => self.0.take(b'[')? && self.0.take(b']')?,
            Some(b'N') => self.0.word()? == "None",
            _ => false,
        };
        self.0.seek(end);
        Ok(!empty)
    }

    /// Reads an attribute or a relationship, whose first word was read.
    fn property(&mut self, mut word: String, prim: &mut Prim) -> Result<()> {
        while matches!(
            word.as_str(),
            "custom"
                | "uniform"
                | "varying"
                | "config"
                | "add"
                | "append"
                | "prepend"
                | "delete"
                | "reorder"
        ) {
            word = self.0.word()?;
        }
        let mut kind = word;
        if self.0.peek()? == Some(b'[') {
            self.0.next()?;
            self.0.expect(b']')?;
            kind += "[]";
        }
        let name = self.0.word()?;
        let (name, suffix) = name.split_once('.').unwrap_or((&name, ""));
        let relationship = kind == "rel";
        let attribute = match Attribute::matters(name) && !relationship {
            true => Some(self.place_of(&mut prim.attributes, name)?),
            false => None,
        };
        let Some(k) = attribute else {
            if self.0.take(b'=')? {
                self.0.skip_value()?;
            }
            if self.0.take(b'(')? {
                self.metadata(|text, _, _| text.0.skip_value())?;
            }
            return Ok(());
        };
        let attribute = &mut prim.attributes[k];
        attribute.kind = kind;
        if self.0.take(b'=')? {
            self.0.space()?;
            let place = Place(self.0.position());
            match suffix {
                "" | "default" => {
                    attribute.default = Some(place);
                    self.0.skip_value()?;
                }
                "timeSamples" => attribute.samples = self.samples()?,
                _ => {
                    attribute.spline |= suffix == "spline";
                    self.0.skip_value()?;
                }
            }
        }
        if self.0.take(b'(')? {
            self.metadata(|text, key, _| {
                match key {
                    "interpolation" => attribute.interpolation = Some(text.0.string()?),
                    _ => text.0.skip_value()?,
                }
                Ok(())
            })?;
        }
        Ok(())
    }

    /// Finds the values of `{ time: value, .. }`.
    fn samples(&mut self) -> Result<Samples> {
        let mut samples: Vec<(f64, Place)> = Vec::new();
        self.0.expect(b'{')?;
        while !self.0.take(b'}')? {
            let time = self.time()?;
            self.0.expect(b':')?;
            self.0.space()?;
            samples.push((time, Place(self.0.position())));
            self.0.skip_value()?;
            self.0.take(b',')?;
        }
        samples.sort_by(|a, b| a.0.total_cmp(&b.0));
        check_times(&samples).map_err(|what| self.0.bad(what))?;
        Ok(samples.into())
    }

    fn time(&mut self) -> Result<f64> {
        self.0.space()?;
        self.0.number(|text| text.parse().ok())
    }

    /// Reads a value of an attribute.
    pub fn value(&mut self, attribute: &Attribute, place: Place) -> Result<Value> {
        let kind = Kind::named(&attribute.kind)?;
        self.0.seek(place.0);
        if self.0.peek()? == Some(b'N') {
            return match self.0.word()?.as_str() {
                "None" => Ok(Value::Blocked),
                _ => Err(self.0.bad("expected a value")),
            };
        }
        let array = attribute.kind.ends_with("[]");
        Ok(match kind {
            Kind::Words => {
                let mut words = Vec::new();
                self.elements(array, |text| {
                    words.push(text.0.string()?);
                    Ok(())
                })?;
                Value::Words(words)
            }
            Kind::Ints => Value::Ints(self.numbers(array, 1)?),
            Kind::Singles(n) => Value::Singles(n, self.numbers(array, n)?),
            Kind::Doubles(n) => Value::Doubles(n, self.numbers(array, n)?),
        })
    }

    /// Calls a function that reads an element: once, or for each element of an array.
    fn elements(
        &mut self,
        array: bool,
        mut each: impl FnMut(&mut Self) -> Result<()>,
    ) -> Result<()> {
        if !array {
            return each(self);
        }
        self.0.expect(b'[')?;
        while !self.0.take(b']')? {
            each(self)?;
            if !self.0.take(b',')? {
                return self.0.expect(b']');
            }
        }
        Ok(())
    }

    /// Reads `n` numbers per element. Sixteen are four rows of four.
    fn numbers<T: std::str::FromStr>(&mut self, array: bool, n: usize) -> Result<Vec<T>> {
        let mut numbers = Vec::new();
        self.elements(array, |text| match n {
            1 => {
                numbers.push(text.0.number(|t| t.parse().ok())?);
                Ok(())
            }
            16 => text.tuple(4, |text| {
                text.tuple(4, |text| {
                    numbers.push(text.0.number(|t| t.parse().ok())?);
                    Ok(())
                })
            }),
            _ => text.tuple(n, |text| {
                numbers.push(text.0.number(|t| t.parse().ok())?);
                Ok(())
            }),
        })?;
        Ok(numbers)
    }

    /// Reads `(element, .. )` of `n` elements.
    #[inline]
    fn tuple(&mut self, n: usize, mut each: impl FnMut(&mut Self) -> Result<()>) -> Result<()> {
        self.0.expect(b'(')?;
        for k in 0..n {
            if k > 0 {
                self.0.expect(b',')?;
            }
            each(self)?;
        }
        self.0.take(b',')?;
        self.0.expect(b')')
    }

    /// Returns the index of the attribute with this name, which is added if it is missing.
    fn place_of(&mut self, attributes: &mut Vec<Attribute>, name: &str) -> Result<usize> {
        let known = attributes.iter().position(|a| a.name == name);
        if let Some(k) = known {
            return Ok(k);
        }
        if attributes.len() == ATTRIBUTES {
            let what = format_args!("more than {ATTRIBUTES} attributes of a prim");
            return Err(self.0.bad(what));
        }
        attributes.push(Attribute {
            name: name.into(),
            ..Attribute::default()
        });
        Ok(attributes.len() - 1)
    }
}
