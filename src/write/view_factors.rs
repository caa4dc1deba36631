//! The matrix of form factors as an NPZ file. With n elements and m sides of surfaces:
//!
//! | array | shape, type | what |
//! |---|---|---|
//! | `form_factors` | (n, n) float32 | from the row's element to the column's, as estimated |
//! | `error` | (n, n) float32 | standard error of each (analytic: a bound on the quadrature's); not with hemicubes |
//! | `scale` | (n) float64 | what a bake multiplies each row by, so that it adds up to what lands |
//! | `closure` | (n) float64 | sum of each row |
//! | `landed` | (n) float64 | share of the element's rays that landed on elements |
//! | `area` | (n) float64 | [m^2] |
//! | `centre`, `normal` | (n, 3) float32 | [m]; unit, to the side that sees |
//! | `surface` | (n) int32 | row of the arrays below |
//! | `back` | (n) bool | on the back of a double-sided surface |
//! | `surface_names` | (m) text | a back is named so, and has a row of its own |
//! | `surface_back` | (m) bool | |
//! | `surface_area` | (m) float64 | [m^2] |
//! | `surface_form_factors` | (m, m) float64 | between whole sides, area-weighted |
//! | `reciprocity_error`, `escaping`, `relative_error` | float64 | see `view_factors::Figures` |
//! | `method`, `scene` | text | the kind of form factor; the scene's file name |

use super::npz::{self, Npz};
use crate::error::{Error, Result};
use crate::transport::Method;
use crate::view_factors::{Side, ViewFactors};
use std::path::Path;

/// What the comments of our archives begin with; the scene's file name follows.
const MARK: &str = "lumel form-factors: ";

/// Writes `found`, the form factors of `scene`, to `path`.
///
/// # Errors
/// `Io` naming the file.
pub fn write(path: &Path, scene: &Path, found: &ViewFactors) -> Result<()> {
    let (n, m) = (found.len(), found.sides.len());
    let figures = found.figures();
    let flat = |v: &[glam::Vec3]| v.iter().flat_map(|v| v.to_array()).collect::<Vec<f32>>();
    let of_sides = |value: fn(&Side) -> f64| found.sides.iter().map(value).collect::<Vec<f64>>();
    let backs: Vec<bool> = found.sides.iter().map(|s| s.back).collect();
    let names: Vec<&str> = found.sides.iter().map(|s| s.name.as_str()).collect();

    let mut file = Npz::create(path)?;
    file.array("form_factors", &[n, n], &found.form_factors)?;
    if let Some(error) = &found.error {
        file.array("error", &[n, n], error)?;
    }
    file.array("scale", &[n], &found.scale)?;
    file.array("closure", &[n], &found.row_sums())?;
    file.array("landed", &[n], &found.landed)?;
    file.array("area", &[n], &found.area)?;
    file.array("centre", &[n, 3], &flat(&found.centre))?;
    file.array("normal", &[n, 3], &flat(&found.normal))?;
    file.array("surface", &[n], &found.side.iter().map(|s| *s as i32).collect::<Vec<i32>>())?;
    file.array("back", &[n], &found.side.iter().map(|s| backs[*s as usize]).collect::<Vec<bool>>())?;
    file.texts("surface_names", &[m], &names)?;
    file.array("surface_back", &[m], &backs)?;
    file.array("surface_area", &[m], &of_sides(|s| s.area))?;
    file.array("surface_form_factors", &[m, m], &found.between_sides)?;
    file.array("reciprocity_error", &[], &[figures.reciprocity_error])?;
    file.array("escaping", &[], &[figures.escaping])?;
    file.array("relative_error", &[], &[f64::from(found.relative_error)])?;
    file.texts("method", &[], &[method_name(found.method)])?;
    file.texts("scene", &[], &[&name(scene)])?;
    file.finish(&format!("{MARK}{}", name(scene)))
}

/// Refuses a file at `path` that doesn't hold form factors of this scene, unless it may be replaced.
///
/// # Errors
/// `Invalid` naming the file.
pub fn refuse_other(path: &Path, scene: &Path, overwrite: bool) -> Result<()> {
    if path.is_dir() {
        return Err(Error::invalid(path.display(), "is a folder; give a file with -o"));
    }
    if overwrite || !path.exists() {
        return Ok(());
    }
    let comment = npz::comment(path);
    let other = match comment.as_deref().and_then(|c| c.strip_prefix(MARK)) {
        Some(of) if of == name(scene) => return Ok(()),
        Some(of) => format!("the form factors of {of}"),
        None => "something else".to_string(),
    };
    Err(Error::invalid(path.display(), format!("holds {other}; choose another file with -o, or --overwrite")))
}

/// As on the command line.
pub fn method_name(method: Method) -> &'static str {
    match method {
        Method::Area => "area",
        Method::Analytic => "analytic",
        Method::Hemicube => "hemicube",
        Method::Hemisphere => "hemisphere",
    }
}

fn name(scene: &Path) -> String {
    scene.file_name().map_or_else(String::new, |n| n.to_string_lossy().into_owned())
}
