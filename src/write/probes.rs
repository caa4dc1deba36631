//! Light probes as JSON, for engines' loaders, and as EXR, for looking up without a parser.
//!
//! `probes.json`: `version`, `space` ("world, right-handed, metres, Y up"), `basis` (the functions, in the order of the coefficients),
//! `unit` ("nit"), `sets` (`first` and `count` of each set's probes; of grids `origin`, `step` [m] and `counts` along X, Y and Z, X the
//! fastest), and `probes`: `position` [m], `coefficients` (nine of R, G, B: radiance, see [`crate::probe::harmonics`]), `valid`,
//! `backs` (the share of rays that met black backs), `distance` (mean [m] and mean square [m^2]).
//!
//! `probes.exr`: 32-bit floats, a row for each probe in the same order, nine texels of R, G, B.

use super::exr::write_image;
use crate::color::Rgb;
use crate::error::{Error, Result};
use crate::probe::{Harmonics, LightProbes, Placement, Probe};
use serde::Serialize;
use std::path::Path;

/// The files, relative to the output folder: JSON, EXR.
pub const FILES: [&str; 2] = ["probes.json", "probes.exr"];

const BASIS: [&str; Harmonics::COUNT] = [
    "0.282095",
    "0.488603 y",
    "0.488603 z",
    "0.488603 x",
    "1.092548 x y",
    "1.092548 y z",
    "0.315392 (3 z^2 - 1)",
    "1.092548 x z",
    "0.546274 (x^2 - y^2)",
];

#[derive(Serialize)]
struct File {
    version: &'static str,
    space: &'static str,
    basis: [&'static str; Harmonics::COUNT],
    unit: &'static str,
    sets: Vec<Set>,
    probes: Vec<Entry>,
}

#[derive(Serialize)]
struct Set {
    first: u64,
    count: u64,
    #[serde(skip_serializing_if = "Option::is_none", flatten)]
    grid: Option<Cells>,
}

#[derive(Serialize)]
struct Cells {
    origin: [f32; 3],
    step: [f32; 3],
    counts: [u32; 3],
}

#[derive(Serialize)]
struct Entry {
    position: [f32; 3],
    coefficients: [[f32; 3]; Harmonics::COUNT],
    valid: bool,
    backs: f32,
    distance: [f32; 2],
}

/// Writes `probes` to the files `json` and `exr`.
///
/// # Errors
/// `Io` naming the file.
pub fn write(json: &Path, exr: &Path, probes: &LightProbes) -> Result<()> {
    let mut first = 0;
    let set = |set: &Placement| {
        let grid = match set {
            Placement::Grid(grid) => Some(Cells {
                origin: grid.origin.to_array(),
                step: grid.step.to_array(),
                counts: grid.counts.to_array(),
            }),
            Placement::Positions(_) => None,
        };
        first += set.len();
        Set { first: first - set.len(), count: set.len(), grid }
    };
    let file = File {
        version: env!("CARGO_PKG_VERSION"),
        space: "world, right-handed, metres, Y up",
        basis: BASIS,
        unit: "nit",
        sets: probes.sets.iter().map(set).collect(),
        probes: probes.list.iter().map(entry).collect(),
    };
    let text = serde_json::to_vec(&file).map_err(|e| Error::invalid(json.display(), e))?;
    std::fs::write(json, text).map_err(|e| Error::io(json, e))?;
    let rows: Vec<Rgb> = probes.list.iter().flat_map(|p| p.radiance.0).collect();
    write_image(exr, Harmonics::COUNT as u32, probes.list.len() as u32, &rows)
}

fn entry(probe: &Probe) -> Entry {
    Entry {
        position: probe.position.to_array(),
        coefficients: probe.radiance.0.map(|c| c.to_array()),
        valid: probe.is_valid(),
        backs: probe.back_share,
        distance: probe.distance,
    }
}
