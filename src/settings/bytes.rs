//! Amounts of memory, written `4G`, `512M`, `4 GiB` or as a number of bytes.

use serde::de::Error;
use serde::{Deserialize, Deserializer};

/// Either form.
#[derive(Deserialize)]
#[serde(untagged)]
enum Form {
    Number(u64),
    Text(String),
}

/// Reads an amount [bytes]; K, M, G and T are powers of 1024.
pub fn read<'de, D: Deserializer<'de>>(from: D) -> Result<Option<u64>, D::Error> {
    let Some(form) = Option::<Form>::deserialize(from)? else { return Ok(None) };
    match form {
        Form::Number(value) => Ok(Some(value)),
        Form::Text(text) => match parse(&text) {
            Some(value) => Ok(Some(value)),
            None => Err(D::Error::custom(format!("`{text}` is no amount of memory, as 4G or 512M is"))),
        },
    }
}

/// The amount [bytes] that `text` says; `None` where it says none.
pub fn parse(text: &str) -> Option<u64> {
    let text = text.trim().trim_end_matches(['B', 'b']).trim_end_matches('i');
    let unit = match text.chars().last()?.to_ascii_uppercase() {
        'K' => 1u64 << 10,
        'M' => 1 << 20,
        'G' => 1 << 30,
        'T' => 1 << 40,
        _ => 1,
    };
    let number = if unit > 1 { &text[..text.len() - 1] } else { text };
    let bytes = number.trim_end().parse::<f64>().ok()? * unit as f64;
    (bytes.is_finite() && bytes >= 0.0).then_some(bytes as u64)
}

#[cfg(test)]
mod tests {
    use super::parse;

    #[test]
    fn units_are_powers_of_1024() {
        for (text, bytes) in [("4G", 4 << 30), ("512 MiB", 512 << 20), ("1.5k", 1536), ("7", 7), ("2TB", 2 << 40)] {
            assert_eq!(parse(text), Some(bytes), "{text}");
        }
        for text in ["", "G", "-1G", "4X", "inf", "nan", "B", "ä"] {
            assert_eq!(parse(text), None, "{text}");
        }
    }
}
