//! A layer of opinions as a tree, and its usda text.
//!
//! The text is written here and not by the USD crate because that crate widens every f32 to f64 (0.1 becomes
//! 0.10000000149011612): a layer of a million UVs is half the size with the shortest text that reads back as the same f32.

use crate::error::{Error, Result};
use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::io::{self, Write};

/// A root layer in the making. Prims come out in the order of their names: opinions of a stronger layer don't change the
/// order of the children that a weaker one defines.
#[derive(Debug, Default)]
pub struct Layer {
    /// Layer metadata, name and value as usda has it, in the order of writing.
    pub metadata: Vec<(String, String)>,
    root: Prim,
}

/// Opinions on one prim.
#[derive(Debug, Default)]
pub struct Prim {
    /// A `class`; else an `over`.
    pub is_class: bool,
    /// Writes `active = false`.
    pub inactive: bool,
    /// Writes `instanceable = false`: prims below it are its own, and take opinions.
    pub taken_apart: bool,
    /// Prims to inherit from, stronger than those of the input.
    pub inherits: Vec<String>,
    /// Another type than the input's.
    pub type_name: Option<&'static str>,
    /// Variants to select, by their sets.
    pub variants: BTreeMap<String, String>,
    attributes: Vec<Attribute>,
    children: BTreeMap<String, Prim>,
}

/// An opinion on one attribute.
#[derive(Clone, Debug)]
pub struct Attribute {
    /// Not known to any schema or convention.
    pub custom: bool,
    pub type_name: &'static str,
    pub name: String,
    /// Its value as usda text.
    pub value: String,
    /// `constant`, `vertex` or `faceVarying`, for a primvar.
    pub interpolation: Option<&'static str>,
    /// Writes `customData = { bool "lumel:baked" = true }`: a value of ours under a name that may hold one of the input's.
    pub baked: bool,
}

impl Layer {
    /// The prim at the absolute `path`, made as an `over` with its ancestors where it is new. The path's elements must be
    /// valid prim names.
    pub fn prim(&mut self, path: &str) -> &mut Prim {
        let elements = path.split('/').filter(|e| !e.is_empty());
        elements.fold(&mut self.root, |prim, element| prim.children.entry(element.to_string()).or_default())
    }

    /// Writes the layer as usda text; equal layers give equal bytes.
    ///
    /// # Errors
    /// Those of `out`.
    pub fn write(&self, out: &mut impl Write) -> io::Result<()> {
        out.write_all(b"#usda 1.0\n(\n")?;
        for (name, value) in &self.metadata {
            writeln!(out, "    {name} = {value}")?;
        }
        out.write_all(b")\n")?;
        for (name, prim) in &self.root.children {
            out.write_all(b"\n")?;
            prim.write(out, name, 0)?;
        }
        Ok(())
    }
}

impl Prim {
    /// Adds an opinion; one of the same name is replaced.
    pub fn set(&mut self, attribute: Attribute) {
        match self.attributes.iter_mut().find(|a| a.name == attribute.name) {
            Some(a) => *a = attribute,
            None => self.attributes.push(attribute),
        }
    }

    /// Inherits from the prim at `path`, once.
    pub fn inherit(&mut self, path: &str) {
        if !self.inherits.iter().any(|p| p == path) {
            self.inherits.push(path.to_string());
        }
    }

    fn write(&self, out: &mut impl Write, name: &str, depth: usize) -> io::Result<()> {
        let indent = "    ".repeat(depth);
        let specifier = if self.is_class { "class" } else { "over" };
        let type_name = self.type_name.map(|name| format!("{name} ")).unwrap_or_default();
        write!(out, "{indent}{specifier} {type_name}{}", quoted(name))?;
        if self.inactive || self.taken_apart || !self.inherits.is_empty() || !self.variants.is_empty() {
            out.write_all(b" (\n")?;
            if self.inactive {
                writeln!(out, "{indent}    active = false")?;
            }
            if self.taken_apart {
                writeln!(out, "{indent}    instanceable = false")?;
            }
            if !self.inherits.is_empty() {
                let paths: Vec<String> = self.inherits.iter().map(|p| format!("<{p}>")).collect();
                writeln!(out, "{indent}    prepend inherits = [{}]", paths.join(", "))?;
            }
            if !self.variants.is_empty() {
                writeln!(out, "{indent}    variants = {{")?;
                for (set, name) in &self.variants {
                    writeln!(out, "{indent}        string {} = {}", quoted(set), quoted(name))?;
                }
                writeln!(out, "{indent}    }}")?;
            }
            write!(out, "{indent})")?;
        }
        write!(out, "\n{indent}{{\n")?;
        for attribute in &self.attributes {
            attribute.write(out, &indent)?;
        }
        for (i, (name, child)) in self.children.iter().enumerate() {
            if i > 0 || !self.attributes.is_empty() {
                out.write_all(b"\n")?;
            }
            child.write(out, name, depth + 1)?;
        }
        writeln!(out, "{indent}}}")
    }
}

impl Attribute {
    /// An attribute that no schema knows.
    pub fn custom(type_name: &'static str, name: impl Into<String>, value: String) -> Self {
        Self { custom: true, type_name, name: name.into(), value, interpolation: None, baked: false }
    }

    /// A primvar, `name` without `primvars:`.
    pub fn primvar(type_name: &'static str, name: &str, interpolation: &'static str, value: String) -> Self {
        let name = format!("primvars:{name}");
        Self { custom: false, type_name, name, value, interpolation: Some(interpolation), baked: false }
    }

    /// An attribute of the prim's own schema.
    pub fn of_schema(type_name: &'static str, name: impl Into<String>, value: String) -> Self {
        Self { custom: false, ..Self::custom(type_name, name, value) }
    }

    fn write(&self, out: &mut impl Write, indent: &str) -> io::Result<()> {
        let custom = if self.custom { "custom " } else { "" };
        write!(out, "{indent}    {custom}{} {} = ", self.type_name, self.name)?;
        out.write_all(self.value.as_bytes())?;
        if self.baked || self.interpolation.is_some() {
            out.write_all(b" (\n")?;
            if self.baked {
                writeln!(out, "{indent}        customData = {{\n{indent}            bool \"lumel:baked\" = 1")?;
                writeln!(out, "{indent}        }}")?;
            }
            if let Some(interpolation) = self.interpolation {
                writeln!(out, "{indent}        interpolation = \"{interpolation}\"")?;
            }
            write!(out, "{indent}    )")?;
        }
        out.write_all(b"\n")
    }
}

/// The shortest text that reads back as the same f32; infinities and NaN, which usda readers don't agree on, become 0.
pub fn float(text: &mut String, v: f32) {
    let size = v.abs();
    // Writing to a String does not fail.
    let _ = if v == 0.0 || !v.is_finite() {
        text.write_str("0")
    } else if (1e-4..1e7).contains(&size) {
        write!(text, "{v}")
    } else {
        write!(text, "{v:e}")
    };
}

/// `(a, b, ...)`.
pub fn tuple(text: &mut String, values: &[f32]) {
    for (i, &v) in values.iter().enumerate() {
        text.push_str(if i == 0 { "(" } else { ", " });
        float(text, v);
    }
    text.push(')');
}

/// `[a, b, ...]`, each item written by `item`.
pub fn array<T>(items: &[T], mut item: impl FnMut(&mut String, &T)) -> String {
    let mut text = String::with_capacity(items.len() * 8 + 2);
    text.push('[');
    for (i, value) in items.iter().enumerate() {
        if i > 0 {
            text.push_str(", ");
        }
        item(&mut text, value);
    }
    text.push(']');
    text
}

/// A string or token between quotes.
pub fn quoted(s: &str) -> String {
    let mut text = String::with_capacity(s.len() + 2);
    text.push('"');
    for c in s.chars() {
        match c {
            '"' => text.push_str("\\\""),
            '\\' => text.push_str("\\\\"),
            '\n' => text.push_str("\\n"),
            '\r' => text.push_str("\\r"),
            '\t' => text.push_str("\\t"),
            c => text.push(c),
        }
    }
    text.push('"');
    text
}

/// An asset path as usda has it.
///
/// # Errors
/// `Unsupported` where it holds what no asset path in usda can hold.
pub fn asset(path: &str) -> Result<String> {
    if path.chars().any(char::is_control) || path.contains("@@@") || path.ends_with('@') {
        let message = "the name has a control character, ends in @ or holds @@@, which USD can't name; rename the file";
        return Err(Error::unsupported(path.escape_debug(), message));
    }
    Ok(if path.contains('@') { format!("@@@{path}@@@") } else { format!("@{path}@") })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn floats_are_short_and_read_back() {
        let values = [0.1, 1.0, -2.5, 1e-7, 1.5e20, f32::MIN_POSITIVE, f32::MAX, 12345.678, 0.333_333_34];
        for v in values {
            let mut text = String::new();
            float(&mut text, v);
            assert_eq!(text.parse::<f32>(), Ok(v), "{text}");
            assert!(text.len() <= 14, "{text}");
        }
        let mut text = String::new();
        tuple(&mut text, &[f32::NAN, f32::INFINITY, -0.0]);
        assert_eq!(text, "(0, 0, 0)");
    }

    #[test]
    fn names_and_paths_are_escaped() {
        assert_eq!(quoted("a \"b\" \\ c"), r#""a \"b\" \\ c""#);
        assert_eq!(asset("./a b.usd").unwrap(), "@./a b.usd@");
        assert_eq!(asset("./a@2x.usd").unwrap(), "@@@./a@2x.usd@@@");
        assert!(asset("./a\nb.usd").is_err());
        assert!(asset("./a@@@b.usd").is_err());
    }
}
