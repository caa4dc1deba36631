//! What a loader is asked for beside the file.

/// How a scene file is read. The default is the file as it stands.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct LoadOptions {
    /// The moment that moving parts are read at: seconds in glTF, a time code in USD. None: at rest in glTF, the default
    /// time in USD.
    pub time: Option<f64>,
    /// glTF: name of the animation that is read, or its number from 0; none: the first one, where there is a `time`. With a name alone the time
    /// is 0.
    pub animation: Option<String>,
    /// What is chosen of what the file offers in several forms. glTF: names of KHR_materials_variants, of which a later one
    /// goes before an earlier one. USD: `PRIM:SET=NAME`.
    pub variants: Vec<String>,
}
