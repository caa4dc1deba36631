//! Animations: what the nodes' properties are at one moment (glTF 2.0 section 3.11 and appendix C).
//!
//! Translation, rotation, scale and morph weights, by STEP, LINEAR (spherical for rotations) or CUBICSPLINE. Before its
//! first and after its last key a curve stays at that key's value. KHR_animation_pointer's channels are skipped and said.

use super::accessor;
use super::document::Document;
use crate::error::{Error, Result, Warnings};
use crate::load::LoadOptions;
use ::gltf::json::accessor::Type;
use glam::DQuat;
use serde::Deserialize;
use serde_json::Value;
use std::collections::HashMap;

/// What an animation gives to a node, in place of the node's own; `None` where it leaves it alone.
#[derive(Clone, Debug, Default)]
pub(super) struct Animated {
    pub translation: Option<[f32; 3]>,
    /// XYZW, unit length.
    pub rotation: Option<[f32; 4]>,
    pub scale: Option<[f32; 3]>,
    /// One a morph target.
    pub weights: Option<Vec<f32>>,
}

/// The animated nodes at the moment that is asked for, by index; empty at rest.
pub(super) type Pose = HashMap<usize, Animated>;

#[derive(Deserialize)]
struct Animation {
    #[serde(default)]
    channels: Vec<Channel>,
    #[serde(default)]
    samplers: Vec<Sampler>,
}

#[derive(Deserialize)]
struct Channel {
    sampler: usize,
    target: Target,
}

#[derive(Deserialize)]
struct Target {
    node: Option<usize>,
    path: String,
}

#[derive(Deserialize)]
struct Sampler {
    input: usize,
    output: usize,
    #[serde(default)]
    interpolation: Interpolation,
}

/// How a curve runs between two keys.
#[derive(Clone, Copy, Debug, Default, Deserialize, PartialEq, Eq)]
#[serde(rename_all = "UPPERCASE")]
enum Interpolation {
    #[default]
    Linear,
    Step,
    CubicSpline,
}

/// Evaluates the animation that `options` names, or the first one, at its time.
///
/// # Errors
/// `Invalid` where there is no animation of that name, or the animation is broken.
pub(super) fn pose(document: &Document, options: &LoadOptions, warnings: &mut Warnings) -> Result<Pose> {
    if options.time.is_none() && options.animation.is_none() {
        return Ok(Pose::new());
    }
    let Some(index) = chosen(document, options.animation.as_deref())? else {
        warnings.add(document.file(), "the file has no animation; it was read at rest");
        return Ok(Pose::new());
    };
    let animation: Animation = document.item("animations", index)?;
    let place = document.place("animations", index);
    let time = options.time.unwrap_or(0.0) as f32;
    let mut pose = Pose::new();
    for channel in &animation.channels {
        let target = &channel.target;
        let known = ["translation", "rotation", "scale", "weights"].contains(&target.path.as_str());
        let Some(node) = target.node.filter(|_| known) else {
            let message = format!("channels of \"{}\" are not read; what they animate stays at rest", target.path);
            warnings.add(&place, message);
            continue;
        };
        let sampler = animation.samplers.get(channel.sampler).ok_or_else(|| {
            Error::invalid(&place, format!("has no sampler {}; export the file again", channel.sampler))
        })?;
        let curve = Curve::read(document, sampler, target, &place)?;
        let value = curve.at(time);
        let broken = || Error::invalid(&place, "has values that are not finite; export the file again");
        if !value.iter().all(|v| v.is_finite()) {
            return Err(broken());
        }
        let animated = pose.entry(node).or_default();
        match target.path.as_str() {
            "translation" => animated.translation = value.try_into().ok(),
            "rotation" => animated.rotation = value.try_into().ok(),
            "scale" => animated.scale = value.try_into().ok(),
            _ => animated.weights = Some(value),
        }
    }
    Ok(pose)
}

/// The animation named `name`, or, where none is, of that number from 0; without a name the first one.
fn chosen(document: &Document, name: Option<&str>) -> Result<Option<usize>> {
    let animations = document.json.get("animations").and_then(Value::as_array).map_or(&[][..], Vec::as_slice);
    let Some(name) = name else { return Ok((!animations.is_empty()).then_some(0)) };
    let names = || animations.iter().map(|a| a.get("name").and_then(Value::as_str).unwrap_or_default());
    let number = || name.parse::<usize>().ok().filter(|&n| n < animations.len());
    match names().position(|n| n == name).or_else(number) {
        Some(index) => Ok(Some(index)),
        None => {
            let there: Vec<String> = names().enumerate().map(|(i, n)| format!("{i} \"{n}\"")).collect();
            let there = if there.is_empty() { "none".to_owned() } else { there.join(", ") };
            Err(Error::invalid(document.file(), format!("has no animation \"{name}\"; there is: {there}")))
        }
    }
}

/// Keys of a property over time.
struct Curve {
    /// Ascending [s].
    times: Vec<f32>,
    /// `width` numbers a key; three times as many (tangent in, value, tangent out) for cubic splines.
    values: Vec<f32>,
    width: usize,
    interpolation: Interpolation,
    rotation: bool,
}

impl Curve {
    fn read(document: &Document, sampler: &Sampler, target: &Target, place: &str) -> Result<Self> {
        let broken = |what: &str| Error::invalid(place, format!("{what}; export the file again"));
        let times = accessor::floats(document, sampler.input, &[Type::Scalar], false)?.into_values();
        if times.is_empty() || !times.iter().all(|t| t.is_finite()) || times.windows(2).any(|w| w[0] > w[1]) {
            return Err(broken("has key times that don't ascend"));
        }
        let (kind, width) = match target.path.as_str() {
            "rotation" => (Type::Vec4, Some(4)),
            "weights" => (Type::Scalar, None),
            _ => (Type::Vec3, Some(3)),
        };
        let values = accessor::floats(document, sampler.output, &[kind], false)?.into_values();
        let parts = if sampler.interpolation == Interpolation::CubicSpline { 3 } else { 1 };
        let width = width.unwrap_or(values.len() / (times.len() * parts));
        if values.len() != times.len() * parts * width {
            return Err(broken("has other numbers of times and values"));
        }
        let rotation = target.path == "rotation";
        Ok(Self { times, values, width, interpolation: sampler.interpolation, rotation })
    }

    /// Part `part` (0 for all but cubic splines) of key `key`.
    fn key(&self, key: usize, part: usize) -> &[f32] {
        let parts = if self.interpolation == Interpolation::CubicSpline { 3 } else { 1 };
        let start = (key * parts + part) * self.width;
        self.values.get(start..start + self.width).unwrap_or_default()
    }

    /// The value of key `key`.
    fn value(&self, key: usize) -> &[f32] {
        self.key(key, usize::from(self.interpolation == Interpolation::CubicSpline))
    }

    /// The value at `time` [s].
    fn at(&self, time: f32) -> Vec<f32> {
        let next = self.times.partition_point(|t| *t <= time);
        let (Some(from), true) = (next.checked_sub(1), next < self.times.len()) else {
            return self.value(next.min(self.times.len() - 1)).to_vec();
        };
        let span = self.times[next] - self.times[from];
        let u = (time - self.times[from]) / span;
        let (a, b) = (self.value(from), self.value(next));
        match self.interpolation {
            Interpolation::Step => a.to_vec(),
            Interpolation::Linear if self.rotation => {
                let quaternion = |v: &[f32]| {
                    let [x, y, z, w] = [0, 1, 2, 3].map(|i| v.get(i).copied().map_or(0.0, f64::from));
                    Some(DQuat::from_xyzw(x, y, z, w)).filter(|q| q.length_squared() > 0.0).map(DQuat::normalize)
                };
                let (a, b) = (quaternion(a).unwrap_or_default(), quaternion(b).unwrap_or_default());
                a.slerp(b, f64::from(u)).to_array().map(|v| v as f32).to_vec()
            }
            Interpolation::Linear => a.iter().zip(b).map(|(a, b)| a + (b - a) * u).collect(),
            Interpolation::CubicSpline => {
                let (out, into) = (self.key(from, 2), self.key(next, 0));
                let (u2, u3) = (u * u, u * u * u);
                let weights =
                    [2.0 * u3 - 3.0 * u2 + 1.0, span * (u3 - 2.0 * u2 + u), 3.0 * u2 - 2.0 * u3, span * (u3 - u2)];
                let ends = a.iter().zip(out).zip(b.iter().zip(into));
                ends.map(|((a, out), (b, into))| weights[0] * a + weights[1] * out + weights[2] * b + weights[3] * into)
                    .collect()
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn curve(interpolation: Interpolation, times: &[f32], values: &[f32], width: usize) -> Curve {
        Curve { times: times.to_vec(), values: values.to_vec(), width, interpolation, rotation: width == 4 }
    }

    #[test]
    fn curves_stay_at_their_ends() {
        let c = curve(Interpolation::Linear, &[1.0, 2.0, 4.0], &[5.0, 7.0, 3.0], 1);
        assert_eq!([0.0, 1.0, 1.5, 3.0, 4.0, 9.0].map(|t| c.at(t)[0]), [5.0, 5.0, 6.0, 5.0, 3.0, 3.0]);
        let c = curve(Interpolation::Step, &[1.0, 2.0], &[5.0, 7.0], 1);
        assert_eq!([0.5, 1.99, 2.0].map(|t| c.at(t)[0]), [5.0, 5.0, 7.0]);
        assert_eq!(curve(Interpolation::Linear, &[3.0], &[5.0], 1).at(0.0), [5.0]);
        // Two keys at one time: a jump.
        assert_eq!(curve(Interpolation::Linear, &[0.0, 1.0, 1.0], &[0.0, 2.0, 8.0], 1).at(1.0), [8.0]);
    }

    /// A cubic through its own tangents is that cubic: x^3 on 0..2.
    #[test]
    fn cubic_splines_follow_their_tangents() {
        let key = |x: f32| [3.0 * x * x, x * x * x, 3.0 * x * x];
        let c = curve(Interpolation::CubicSpline, &[0.0, 2.0], &[key(0.0), key(2.0)].concat(), 1);
        for x in [0.0, 0.3, 1.0, 1.7, 2.0] {
            assert!((c.at(x)[0] - x * x * x).abs() < 1e-5, "{x}");
        }
    }

    #[test]
    fn rotations_turn_the_short_way_at_an_even_rate() {
        let half = std::f32::consts::FRAC_1_SQRT_2;
        // A quarter turn about Z, whose end is given with the other sign.
        let c = curve(Interpolation::Linear, &[0.0, 1.0], &[0.0, 0.0, 0.0, 1.0, 0.0, 0.0, -half, -half], 4);
        let third = std::f32::consts::FRAC_PI_2 / 3.0 / 2.0;
        let got = c.at(1.0 / 3.0);
        let sign = got[3].signum();
        assert!((got[2] * sign - third.sin()).abs() < 1e-6 && (got[3] * sign - third.cos()).abs() < 1e-6, "{got:?}");
    }
}
