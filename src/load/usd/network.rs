//! Shader networks: where an input's value comes from.

use super::read::{self, Reading};
use openusd::sdf::Value;
use openusd::usd::{Attribute, Prim};

/// Connections followed before a network counts as endless.
const MAX_HOPS: usize = 64;

/// What stands at the end of an input's connections.
pub enum Origin {
    /// A value on the input itself or on the interface that it is connected to; `None` where nothing is authored.
    Value(Option<Value>),
    /// An output of a shader.
    Shader { shader: Prim, output: String },
}

/// Follows `attribute` through NodeGraph and Material interfaces to a value or a shader.
pub fn trace(attribute: &Attribute, warnings: &mut Reading) -> Origin {
    let mut at = attribute.clone();
    for _ in 0..MAX_HOPS {
        let connections = at.connections().unwrap_or_default();
        if connections.len() > 1 {
            warnings.add(at.path(), "an input has several connections; the first is used");
        }
        let Some((prim, property)) = connections.first().and_then(|target| target.split_property()) else {
            return Origin::Value(read::attribute_value(&at, warnings));
        };
        let Some(prim) = at.stage().prim(prim).ok().filter(|prim| prim.is_valid().unwrap_or(false)) else {
            warnings.add(at.path(), "an input is connected to a prim that is not there; its own value is used");
            return Origin::Value(read::attribute_value(&at, warnings));
        };
        let is_shader = prim.type_name().ok().flatten().is_some_and(|t| t.as_str() == "Shader");
        if let (true, Some(output)) = (is_shader, property.strip_prefix("outputs:")) {
            return Origin::Shader { output: output.to_owned(), shader: prim };
        }
        at = prim.attribute(property);
    }
    warnings.add(attribute.path(), "a connection runs in a circle; the input was left out");
    Origin::Value(None)
}

/// The value of the input `name` of `shader`, where no shader feeds it.
pub fn input(shader: &Prim, name: &str, warnings: &mut Reading) -> Option<Value> {
    match trace(&shader.attribute(format!("inputs:{name}")), warnings) {
        Origin::Value(value) => value,
        Origin::Shader { .. } => {
            warnings.add(shader.path(), format!("the connection of input {name} is not supported and was left out"));
            None
        }
    }
}

/// The shader's identifier.
pub fn shader_id(shader: &Prim, warnings: &mut Reading) -> String {
    read::token(shader, "info:id", warnings).unwrap_or_default()
}
