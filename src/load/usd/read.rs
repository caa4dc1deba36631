//! Attribute values as plain numbers, at the time that a bake sees.
//!
//! Without a time code that is the default time, and an attribute that holds samples alone is read at its earliest one;
//! with one, values are interpolated between samples as the stage has it (linear, rotations spherically), value clips
//! included. USD stores one quantity in many precisions (half, float, double); all of them end here.

use crate::error::Warnings;
use glam::{DMat4, DVec3, DVec4, Quat, Vec2, Vec3, Vec4};
use openusd::sdf::Value;
use openusd::usd::{Attribute, Prim, ResolveInfoSource, TimeCode};
use std::fmt::Display;

/// One reading of a stage: the moment that it sees, and what it met and did not read.
#[derive(Debug, Default)]
pub struct Reading {
    /// None: the default time.
    pub time: Option<TimeCode>,
    pub warnings: Warnings,
}

impl Reading {
    /// Counts the warning `message` at `place`.
    pub fn add(&mut self, place: impl Display, message: impl Display) {
        self.warnings.add(place, message);
    }

    /// Counts the warning `message` at `place`, where input is missing or can't be read.
    pub fn add_missing(&mut self, place: impl Display, message: impl Display) {
        self.warnings.add_missing(place, message);
    }
}

/// The value of `attribute` at the reading's time code; without one its default, else its earliest sample, else the schema's
/// fallback. A value that can't be read is a warning.
pub fn attribute_value(attribute: &Attribute, reading: &mut Reading) -> Option<Value> {
    let time = reading.time;
    let read = || {
        if time.is_some() {
            return attribute.get_at::<Value>(time);
        }
        let at_default = attribute.resolve_info_at(None)?;
        if at_default.source() == ResolveInfoSource::Default {
            return attribute.get::<Value>();
        }
        attribute.get_at::<Value>(TimeCode::EARLIEST)
    };
    read().unwrap_or_else(|error| {
        reading.add(attribute.path(), format!("a value could not be read and was left out: {error}"));
        None
    })
}

/// The value of the attribute `name` of `prim`.
pub fn value(prim: &Prim, name: &str, reading: &mut Reading) -> Option<Value> {
    attribute_value(&prim.attribute(name), reading)
}

/// True where a layer says something about the attribute `name`.
pub fn is_authored(prim: &Prim, name: &str) -> bool {
    prim.attribute(name).has_authored_value().unwrap_or(false)
}

pub fn float(prim: &Prim, name: &str, reading: &mut Reading) -> Option<f32> {
    value(prim, name, reading).and_then(to_float)
}

pub fn boolean(prim: &Prim, name: &str, reading: &mut Reading) -> Option<bool> {
    value(prim, name, reading).and_then(to_bool)
}

pub fn token(prim: &Prim, name: &str, reading: &mut Reading) -> Option<String> {
    value(prim, name, reading).and_then(to_text)
}

pub fn rgb(prim: &Prim, name: &str, reading: &mut Reading) -> Option<Vec3> {
    value(prim, name, reading).and_then(to_vec3)
}

pub fn to_bool(value: Value) -> Option<bool> {
    match value {
        Value::Bool(v) => Some(v),
        Value::Uchar(v) => Some(v != 0),
        Value::Int(v) => Some(v != 0),
        _ => None,
    }
}

pub fn to_float(value: Value) -> Option<f32> {
    match value {
        Value::Half(v) => Some(v.to_f32()),
        Value::Float(v) => Some(v),
        Value::Double(v) => Some(v as f32),
        Value::Int(v) => Some(v as f32),
        _ => None,
    }
}

/// A token or string.
pub fn to_text(value: Value) -> Option<String> {
    match value {
        Value::Token(v) => Some(v.as_str().to_owned()),
        Value::String(v) => Some(v),
        _ => None,
    }
}

pub fn to_vec2(value: Value) -> Option<Vec2> {
    match value {
        Value::Vec2h(v) => Some(Vec2::new(v.x.to_f32(), v.y.to_f32())),
        Value::Vec2f(v) => Some(Vec2::new(v.x, v.y)),
        Value::Vec2d(v) => Some(Vec2::new(v.x as f32, v.y as f32)),
        _ => None,
    }
}

pub fn to_vec3(value: Value) -> Option<Vec3> {
    match value {
        Value::Vec3h(v) => Some(Vec3::new(v.x.to_f32(), v.y.to_f32(), v.z.to_f32())),
        Value::Vec3f(v) => Some(Vec3::new(v.x, v.y, v.z)),
        Value::Vec3d(v) => Some(Vec3::new(v.x as f32, v.y as f32, v.z as f32)),
        _ => None,
    }
}

pub fn to_vec4(value: Value) -> Option<Vec4> {
    match value {
        Value::Vec4h(v) => Some(Vec4::new(v.x.to_f32(), v.y.to_f32(), v.z.to_f32(), v.w.to_f32())),
        Value::Vec4f(v) => Some(Vec4::new(v.x, v.y, v.z, v.w)),
        Value::Vec4d(v) => Some(DVec4::new(v.x, v.y, v.z, v.w).as_vec4()),
        _ => None,
    }
}

/// A float array; a single float is an array of one.
pub fn to_floats(value: Value) -> Option<Vec<f32>> {
    match value {
        Value::HalfVec(v) => Some(v.into_iter().map(|v| v.to_f32()).collect()),
        Value::FloatVec(v) => Some(v),
        Value::DoubleVec(v) => Some(v.into_iter().map(|v| v as f32).collect()),
        single => to_float(single).map(|v| vec![v]),
    }
}

pub fn to_ints(value: Value) -> Option<Vec<i32>> {
    match value {
        Value::IntVec(v) => Some(v),
        Value::UintVec(v) => Some(v.into_iter().map(|v| i32::try_from(v).unwrap_or(-1)).collect()),
        Value::Int64Vec(v) => Some(v.into_iter().map(|v| i32::try_from(v).unwrap_or(-1)).collect()),
        _ => None,
    }
}

pub fn to_int64s(value: Value) -> Option<Vec<i64>> {
    match value {
        Value::Int64Vec(v) => Some(v),
        Value::IntVec(v) => Some(v.into_iter().map(i64::from).collect()),
        _ => None,
    }
}

/// A float2 array; a single pair is an array of one.
pub fn to_vec2s(value: Value) -> Option<Vec<Vec2>> {
    match value {
        Value::Vec2hVec(v) => Some(v.into_iter().map(|v| Vec2::new(v.x.to_f32(), v.y.to_f32())).collect()),
        Value::Vec2fVec(v) => Some(v.into_iter().map(|v| Vec2::new(v.x, v.y)).collect()),
        Value::Vec2dVec(v) => Some(v.into_iter().map(|v| Vec2::new(v.x as f32, v.y as f32)).collect()),
        single => to_vec2(single).map(|v| vec![v]),
    }
}

/// A float3 array; a single triple is an array of one.
pub fn to_vec3s(value: Value) -> Option<Vec<Vec3>> {
    match value {
        Value::Vec3hVec(v) => {
            Some(v.into_iter().map(|v| Vec3::new(v.x.to_f32(), v.y.to_f32(), v.z.to_f32())).collect())
        }
        Value::Vec3fVec(v) => Some(v.into_iter().map(|v| Vec3::new(v.x, v.y, v.z)).collect()),
        Value::Vec3dVec(v) => Some(v.into_iter().map(|v| DVec3::new(v.x, v.y, v.z).as_vec3()).collect()),
        single => to_vec3(single).map(|v| vec![v]),
    }
}

/// Rotations, normalized; one without length is the identity.
pub fn to_quats(value: Value) -> Option<Vec<Quat>> {
    let quat = |w: f32, x: f32, y: f32, z: f32| {
        let v = Vec4::new(x, y, z, w);
        v.try_normalize().map_or(Quat::IDENTITY, Quat::from_vec4)
    };
    match value {
        Value::QuathVec(v) => {
            Some(v.into_iter().map(|q| quat(q.w.to_f32(), q.x.to_f32(), q.y.to_f32(), q.z.to_f32())).collect())
        }
        Value::QuatfVec(v) => Some(v.into_iter().map(|q| quat(q.w, q.x, q.y, q.z)).collect()),
        Value::QuatdVec(v) => {
            Some(v.into_iter().map(|q| quat(q.w as f32, q.x as f32, q.y as f32, q.z as f32)).collect())
        }
        _ => None,
    }
}

/// A USD matrix, which takes row vectors, as glam's, which takes column vectors.
pub fn to_matrix(m: &openusd::gf::Matrix4d) -> DMat4 {
    DMat4::from_cols_array(&m.0)
}
