//! Percentages, written `2%` or `2 %` or as the number alone.

use serde::de::Error;
use serde::{Deserialize, Deserializer, Serializer};

/// Either form.
#[derive(Deserialize)]
#[serde(untagged)]
enum Form {
    Number(f64),
    Text(String),
}

/// Reads a percentage.
pub fn read<'de, D: Deserializer<'de>>(from: D) -> Result<Option<f64>, D::Error> {
    let Some(form) = Option::<Form>::deserialize(from)? else { return Ok(None) };
    match form {
        Form::Number(value) => Ok(Some(value)),
        Form::Text(text) => {
            let number = text.trim().trim_end_matches('%').trim_end();
            let value = number.parse().map_err(|_| D::Error::custom(format!("`{text}` is no percentage, as 2% is")))?;
            Ok(Some(value))
        }
    }
}

/// Writes one as a number.
pub fn write<S: Serializer>(value: &Option<f64>, to: S) -> Result<S::Ok, S::Error> {
    match value {
        Some(value) => to.serialize_f64(*value),
        None => to.serialize_none(),
    }
}
