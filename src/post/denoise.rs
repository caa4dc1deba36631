//! Noise taken out of the light that texels gathered each on its own.
//!
//! Texels of one chart know about each other: what their differences have beyond the noise that two independent halves of the
//! samples tell is detail, the rest is noise ([`scales`]). Intel's Open Image Denoise, where its library is present and asked for,
//! knows what lightmaps look like instead ([`oidn`]). Neither looks across the border of a chart.
//!
//! Light by blocks ([`crate::blocks`]) was smoothed in the same manner while it was solved, block by block; between blocks and
//! over wider stretches more can be told from noise.

pub mod oidn;
mod rows;
pub mod scales;

use crate::color::{Rgb, luminance};
use crate::error::Result;
use crate::gather::Gathered;
use crate::light::Lit;
use crate::progress::Progress;
use oidn::Oidn;
use scales::Scales;
use std::path::PathBuf;

/// Which filter takes noise out.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Denoise {
    /// [`Denoise::Builtin`]; none for paths, the reference.
    #[default]
    Auto,
    /// The filter of this module.
    Builtin,
    /// Intel's Open Image Denoise.
    Oidn,
    /// None.
    Off,
}

/// What is asked for.
#[derive(Clone, Debug)]
pub struct DenoiseParams {
    pub filter: Denoise,
    /// The built-in filter, where it is the one.
    pub scales: Scales,
    /// The library of Open Image Denoise; none: looked for by its usual names.
    pub library: Option<PathBuf>,
}

/// What was done.
#[derive(Clone, Debug, Default, serde::Serialize)]
pub struct DenoiseReport {
    /// `builtin` or the name and version of Open Image Denoise.
    pub filter: String,
    /// Standard error of the light that was filtered, root mean square over mean irradiance [%]: before, and of what is left of
    /// it as far as the filter knows.
    pub before: f64,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub after: Option<f64>,
}

/// Takes the noise out of the gathered part of `gathered`, in place, and of the parts of it that are kept. `None` where there
/// is nothing to do: no halves to tell noise by, or no filter wanted.
///
/// # Errors
/// `Invalid` where Open Image Denoise is asked for and not found, or fails; `Cancelled`.
pub fn denoise(
    lit: &Lit,
    gathered: &mut Gathered,
    params: &DenoiseParams,
    progress: &dyn Progress,
) -> Result<Option<DenoiseReport>> {
    if params.filter == Denoise::Off || gathered.difference.is_empty() {
        return Ok(None);
    }
    progress.begin("denoise", 0);
    let before = noise(lit, gathered);
    gathered.irradiance.iter_mut().zip(&gathered.indirect).for_each(|(e, i)| *e -= *i);
    let Gathered { indirect, difference, sky, parts, .. } = gathered;
    let mut rest: Vec<&mut Vec<Rgb>> = std::iter::once(sky).chain(parts).filter(|part| has_light(part)).collect();
    let mut report = DenoiseReport { filter: "builtin".into(), before: 100.0 * before, after: None };
    match params.filter {
        Denoise::Oidn => {
            let library = Oidn::open(params.library.as_deref())?;
            report.filter = library.name();
            library.filter(lit, indirect, progress)?;
            for part in rest {
                library.filter(lit, part, progress)?;
            }
        }
        _ => params.scales.filter(lit, indirect, difference, &mut rest, progress)?,
    }
    gathered.irradiance.iter_mut().zip(&gathered.indirect).for_each(|(e, i)| *e = (*e + *i).max(Rgb::ZERO));
    if params.filter != Denoise::Oidn {
        if !gathered.standard_error.is_empty() {
            gathered.standard_error = gathered.difference.iter().map(|d| d.abs()).collect();
        }
        gathered.noise = noise(lit, gathered);
        report.after = Some(100.0 * gathered.noise);
    }
    Ok(Some(report))
}

fn has_light(part: &[Rgb]) -> bool {
    part.iter().any(|v| *v != Rgb::ZERO)
}

/// Standard error of the gathered light, root mean square over mean irradiance (luminance). Where light was known already it has none.
fn noise(lit: &Lit, gathered: &Gathered) -> f64 {
    let (mut squares, mut gathering, mut sum, mut whole) = (0.0, 0.0, 0.0, 0.0);
    let light = gathered.irradiance.iter().zip(&gathered.difference).zip(&lit.exposure.area);
    for (i, ((e, difference), area)) in light.enumerate() {
        let area = f64::from(*area);
        if !lit.is_known(i) {
            squares += f64::from(luminance(*difference)).powi(2) * area;
            gathering += area;
        }
        sum += f64::from(luminance(*e)) * area;
        whole += area;
    }
    if sum > 0.0 && gathering > 0.0 { (squares / gathering).sqrt() / (sum / whole) } else { 0.0 }
}
