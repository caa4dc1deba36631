//! What a loader is asked for beside the file.

/// How a scene file is read. The default is the file as it stands.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct LoadOptions {
    /// The moment that moving parts are read at: seconds in glTF, a time code in USD. None: at rest in glTF, the default
    /// time in USD.
    pub time: Option<f64>,
}
