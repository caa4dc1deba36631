//! Form factors as a result of their own (view factors, as heat transfer calls them): the whole matrix between the elements of
//! a small scene, and between its surfaces.
//!
//! `F_ij` is the share of what leaves element i, as Lambert has it, that arrives at element j; between sides of surfaces
//! `F_ab = 1/A_a * sum over i in a of A_i * sum over j in b of F_ij`. No element reaches from one surface to another, so those
//! sums are exact. The back of a double-sided surface is a side of its own; a single-sided back is black, blocks, and has no row.
//!
//! What is given are estimates as the method found them, with their standard errors. Bakes multiply each row so that it adds up
//! to what the element's rays saw land (`Row::scale`); the factor stands beside, for whoever wants closed rows.
//!
//! Area sampling here means: the analytic form factor times the visibility that segments find, at any distance, wherever both
//! elements are of few polygons and not buried in part; area sampling proper elsewhere. Every pair gets its own work, however
//! small its form factor (bakes only glance at those).
//!
//! Cost: 0.1 to 1 ms a pair and core, by the error asked for; on two cores 256 elements take seconds, 2000 minutes to an hour,
//! the most that are allowed days. Memory: 8 bytes for each of n^2 pairs. Limits: patches that lie wholly inside other geometry
//! belong to no element.

use crate::error::{Error, Result, Warnings};
use crate::light::direct::DirectParams;
use crate::light::{Lights, Lit};
use crate::patch::unocclude::unocclude;
use crate::patch::{Ground, rasterize, reflectance::reflectance};
use crate::progress::Progress;
use crate::scene::Scene;
use crate::trace::Tracer;
use crate::transport::hemicube::{Hemicube, HemicubeParams};
use crate::transport::{Effort, Elements, FormFactor, Method, Outline, Probes, analytic, area, near, row};
use crate::unwrap::Atlas;
use glam::Vec3;
use rayon::prelude::*;
use serde::Serialize;

/// Elements at most: 3.2 GB, and every array of the file below the 4 GiB that plain zip archives end at.
pub const MOST_ELEMENTS: usize = 20_000;

/// Sides of surfaces up to which [`Figures`] hold the matrix between them.
pub const MOST_SHOWN: usize = 12;

/// Samples before a pair's first look at its error, and at most.
const FIRST_SAMPLES: u32 = 16;
const MOST_SAMPLES: u32 = 1 << 14;

/// Share of the error asked for that the analytic method's bound may take: it doesn't average out over pairs as chance does.
const QUADRATURE: f32 = 0.1;

/// How form factors are found.
#[derive(Clone, Debug)]
pub struct ViewFactorParams {
    pub method: Method,
    /// About how many elements, 1..=[`MOST_ELEMENTS`]; each surface has one at least for each way of the axes that it faces, and
    /// backs come on top.
    pub elements: usize,
    /// Standard error of each form factor that is aimed at, relative to it, or to the mean 1 / n where it is smaller than that;
    /// a tenth of it bounds the quadrature's error.
    pub relative_error: f32,
    pub hemicube: HemicubeParams,
    /// Rays that probe each element, a power of two up to 65536; the method hemisphere has no others.
    pub probe_rays: u32,
    /// Of no influence: probes look at the sky in passing.
    pub direct: DirectParams,
    pub seed: u32,
}

/// One side of a surface.
#[derive(Clone, Debug, Serialize)]
pub struct Side {
    /// The surface's name, with ` (back)` behind it where it is that.
    pub name: String,
    /// True on the back of a double-sided surface.
    pub back: bool,
    /// Area of its elements [m^2].
    pub area: f64,
    pub elements: usize,
}

/// Form factors between n elements and between m sides of surfaces. Matrices are row by row.
#[derive(Clone, Debug)]
pub struct ViewFactors {
    pub method: Method,
    /// As asked for.
    pub relative_error: f32,
    /// From element i to j, as estimated: n x n.
    pub form_factors: Vec<f32>,
    /// Standard error of each; a bound on the quadrature's error where the method is analytic; absent where it is the hemicube,
    /// whose aliasing is no matter of chance.
    pub error: Option<Vec<f32>>,
    /// What a bake multiplies each row by.
    pub scale: Vec<f64>,
    /// Share of each element's probe rays that landed on elements; the rest escaped, or fell on black backs.
    pub landed: Vec<f64>,
    /// Area of each element [m^2].
    pub area: Vec<f64>,
    /// Area-weighted centre of each element [m].
    pub centre: Vec<Vec3>,
    /// Mean normal of each element, unit, to the side that sees.
    pub normal: Vec<Vec3>,
    /// The side that each element is part of, an index into `sides`; ascending.
    pub side: Vec<u32>,
    /// Sides with elements, by surface.
    pub sides: Vec<Side>,
    /// From side a to b: m x m.
    pub between_sides: Vec<f64>,
    pub warnings: Warnings,
}

/// How good a matrix is, and what is small enough of it to be shown.
#[derive(Clone, Debug, Serialize)]
pub struct Figures {
    pub method: Method,
    /// Relative standard error that was aimed at.
    pub relative_error: f32,
    pub elements: usize,
    pub row_sums: RowSums,
    /// Root of the sum of squares of `A_i F_ij - A_j F_ji`, relative to that of `A_i F_ij`; 0 but for rounding where the method
    /// finds each pair once.
    pub reciprocity_error: f64,
    /// Share of what leaves all elements that lands on none: it escapes, or falls on backs of single-sided surfaces.
    pub escaping: f64,
    pub surfaces: Vec<Side>,
    /// Rows of form factors between `surfaces`; absent above [`MOST_SHOWN`] of them.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub surface_form_factors: Option<Vec<Vec<f64>>>,
    pub warnings: Warnings,
}

/// Sums of rows, and how far they are from the share of rays that landed (which is 1 in a closed scene).
#[derive(Clone, Copy, Debug, Default, Serialize)]
pub struct RowSums {
    /// Area-weighted mean.
    pub mean: f64,
    /// Area-weighted root mean square of the differences.
    pub rms_error: f64,
    /// The largest difference.
    pub worst_error: f64,
}

/// Refuses more elements than a matrix may have.
///
/// # Errors
/// `Invalid`, naming the setting.
pub fn refuse_too_many(elements: usize) -> Result<()> {
    if (1..=MOST_ELEMENTS).contains(&elements) {
        return Ok(());
    }
    let message = format!("{elements} is out of range for a matrix of form factors; allowed are 1 to {MOST_ELEMENTS}");
    Err(Error::invalid("elements", message))
}

/// Finds all form factors of a scene in memory, whose texels are laid out by `atlas`. No light is needed, none matters.
///
/// # Errors
/// `Cancelled`; `Invalid` where no texel is covered, all of them lie inside others, or there are too many elements.
pub fn view_factors(
    scene: &Scene,
    atlas: &Atlas,
    params: &ViewFactorParams,
    progress: &dyn Progress,
) -> Result<ViewFactors> {
    refuse_too_many(params.elements)?;
    let tracer = Tracer::new(scene);
    let patches = rasterize(scene, atlas, tracer.triangles(), progress)?;
    let ground = Ground { scene, atlas, tracer: &tracer, patches: &patches };
    let (reflectance, emission) = reflectance(&ground, progress)?;
    let exposure = unocclude(&ground, params.seed, progress)?;
    let lights = Lights::new(scene);
    let lit = Lit {
        ground: &ground,
        exposure: &exposure,
        reflectance: &reflectance,
        emission: &emission,
        lights: &lights,
        params: &params.direct,
        known: None,
    };
    let elements = Elements::within_surfaces(&ground, &exposure, &reflectance, params.elements, params.seed);
    let n = elements.len();
    if n == 0 {
        return Err(Error::invalid("form factors", "every texel lies inside other geometry: nothing sees anything"));
    }
    if n > MOST_ELEMENTS {
        let message = format!(
            "{n} come of {}: every surface has at least one for each way that it faces, and backs their own; at most \
             {MOST_ELEMENTS} make a matrix, so ask for fewer, or for fewer surfaces at once",
            params.elements
        );
        return Err(Error::invalid("elements", message));
    }

    progress.begin("probe", 0);
    let probes = Probes::new(&elements, lit, params.probe_rays);
    probes.shoot(|_| true, progress)?;
    let (form_factors, error) = matrix(&elements, &ground, &probes, params, progress)?;

    let landed: Vec<f64> = (0..n).map(|i| f64::from(probes.of(i).landed_share)).collect();
    let sums = form_factors.par_chunks(n).map(|row| row.iter().map(|f| f64::from(*f)).sum::<f64>());
    let scale = sums.enumerate().map(|(i, sum)| row::closure(params.method, sum, || landed[i] as f32)).collect();
    let (sides, side) = sides(scene, &elements);
    let mut found = ViewFactors {
        method: params.method,
        relative_error: params.relative_error,
        form_factors,
        error: (params.method != Method::Hemicube).then_some(error),
        scale,
        landed,
        area: elements.area.iter().map(|a| f64::from(*a)).collect(),
        centre: elements.centre.clone(),
        normal: elements.cluster.iter().map(|c| c.axis).collect(),
        side,
        sides,
        between_sides: Vec::new(),
        warnings: warnings(scene, &elements, params.method),
    };
    found.between_sides = found.sum_over_sides();
    Ok(found)
}

/// All form factors and their errors, row by row.
fn matrix(
    elements: &Elements,
    ground: &Ground,
    probes: &Probes,
    params: &ViewFactorParams,
    progress: &dyn Progress,
) -> Result<(Vec<f32>, Vec<f32>)> {
    let n = elements.len();
    let effort = Effort {
        relative_error: params.relative_error,
        floor: 1.0 / n as f32,
        first_samples: FIRST_SAMPLES,
        most_samples: MOST_SAMPLES,
    };
    let exact = Effort { relative_error: QUADRATURE * params.relative_error, ..effort };
    // Both find A_i F_ij once for i and j.
    let is_symmetric = matches!(params.method, Method::Area | Method::Analytic);
    let outlines = if is_symmetric { Outline::all(elements, ground) } else { Vec::new() };
    let counted = |share: f32| f64::from(share * (1.0 - share) / probes.rays() as f32).sqrt() as f32;
    let pair = |i: usize, j: usize| {
        let [a, b] = [i, j].map(|e| &elements.cluster[e]);
        let outlines = [&outlines[i], &outlines[j]];
        if !a.can_see(b) {
            return FormFactor::default();
        }
        match params.method {
            Method::Analytic => analytic::form_factor(elements, i, j, outlines, &exact),
            // What sees itself is told by rays: points on both meet. So is what is cut too finely for more.
            _ if i == j => probes.between(i, i),
            // Without noise where nothing blocks, at any distance.
            _ if near::is_quick(outlines) => near::form_factor(elements, ground, i, j, outlines, &effort),
            _ if elements.are_near(i, j) => probes.between(i, j),
            _ => area::form_factor(elements, ground, i, j, &effort),
        }
    };
    progress.begin("form factors", n as u64);
    let (mut values, mut errors) = (vec![0.0f32; n * n], vec![0.0f32; n * n]);
    let rows = values.par_chunks_mut(n).zip(errors.par_chunks_mut(n)).enumerate().with_max_len(1);
    rows.try_for_each(|(i, (values, errors))| {
        match params.method {
            Method::Area | Method::Analytic => {
                for j in i..n {
                    progress.check()?;
                    let f = pair(i, j);
                    (values[j], errors[j]) = (f.value as f32, f.error as f32);
                }
            }
            Method::Hemisphere => {
                for &(j, share) in &probes.of(i).landed {
                    (values[j as usize], errors[j as usize]) = (share, counted(share));
                }
            }
            Method::Hemicube => {
                progress.check()?;
                for (j, share) in Hemicube::new(&params.hemicube).row(elements, ground, i) {
                    values[j as usize] = share;
                }
            }
        }
        progress.advance(1);
        progress.check()
    })?;
    if is_symmetric {
        for i in 0..n {
            for j in 0..i {
                let ratio = elements.area[j] / elements.area[i];
                values[i * n + j] = values[j * n + i] * ratio;
                errors[i * n + j] = errors[j * n + i] * ratio;
            }
        }
    }
    Ok((values, errors))
}

/// The sides that have elements, and the side of each element.
fn sides(scene: &Scene, elements: &Elements) -> (Vec<Side>, Vec<u32>) {
    let (mut sides, mut side): (Vec<Side>, Vec<u32>) = (Vec::new(), Vec::new());
    let key = |e: usize| (elements.surface[e], elements.back[e]);
    for e in 0..elements.len() {
        // Elements are sorted by surface and side.
        if e == 0 || key(e) != key(e - 1) {
            let (surface, back) = key(e);
            let name = &scene.surfaces[surface as usize].name;
            let name = if back { format!("{name} (back)") } else { name.clone() };
            sides.push(Side { name, back, area: 0.0, elements: 0 });
        }
        side.push(sides.len() as u32 - 1);
        let last = sides.last_mut().expect("just pushed or there before");
        last.area += f64::from(elements.area[e]);
        last.elements += 1;
    }
    (sides, side)
}

fn warnings(scene: &Scene, elements: &Elements, method: Method) -> Warnings {
    let mut warnings = Warnings::default();
    if method == Method::Analytic {
        warnings.add("--form-factors analytic", "knows no occluders: right only where nothing stands in between");
    }
    for (s, surface) in scene.surfaces.iter().enumerate() {
        if elements.surface.binary_search(&(s as u32)).is_err() {
            warnings.add(&surface.name, "has no row: it has no area, or lies wholly inside other geometry");
        }
    }
    warnings
}

impl ViewFactors {
    /// Number of elements.
    pub fn len(&self) -> usize {
        self.area.len()
    }

    /// True where there is none.
    pub fn is_empty(&self) -> bool {
        self.area.is_empty()
    }

    /// The sum of each row.
    pub fn row_sums(&self) -> Vec<f64> {
        self.form_factors.par_chunks(self.len()).map(|row| row.iter().map(|f| f64::from(*f)).sum()).collect()
    }

    /// How good the matrix is.
    pub fn figures(&self) -> Figures {
        let (n, sums) = (self.len(), self.row_sums());
        let whole: f64 = self.area.iter().sum();
        let mean = |value: &dyn Fn(usize) -> f64| (0..n).map(|i| self.area[i] * value(i)).sum::<f64>() / whole;
        let off = |i: usize| sums[i] - self.landed[i];
        let row_sums = RowSums {
            mean: mean(&|i| sums[i]),
            rms_error: mean(&|i| off(i).powi(2)).sqrt(),
            worst_error: (0..n).map(off).fold(0.0, |worst, v| if v.abs() > worst.abs() { v } else { worst }),
        };
        let m = self.sides.len();
        let shown = m <= MOST_SHOWN;
        Figures {
            method: self.method,
            relative_error: self.relative_error,
            elements: n,
            row_sums,
            reciprocity_error: self.reciprocity_error(),
            escaping: 1.0 - mean(&|i| self.landed[i]),
            surfaces: self.sides.clone(),
            surface_form_factors: shown.then(|| self.between_sides.chunks(m).map(<[f64]>::to_vec).collect()),
            warnings: self.warnings.clone(),
        }
    }

    fn reciprocity_error(&self) -> f64 {
        let n = self.len();
        let sent = |i: usize, j: usize| self.area[i] * f64::from(self.form_factors[i * n + j]);
        let row = |i: usize| {
            let (mut off, mut all) = (0.0, 0.0);
            for j in 0..n {
                let there = sent(i, j);
                off += (there - sent(j, i)).powi(2);
                all += there.powi(2);
            }
            (off, all)
        };
        let rows: Vec<(f64, f64)> = (0..n).into_par_iter().map(row).collect();
        let (off, all) = rows.iter().fold((0.0, 0.0), |sum, r| (sum.0 + r.0, sum.1 + r.1));
        if all > 0.0 { (off / all).sqrt() } else { 0.0 }
    }

    /// Form factors between sides.
    fn sum_over_sides(&self) -> Vec<f64> {
        let (n, m) = (self.len(), self.sides.len());
        let mut sums = vec![0.0; m * m];
        for (i, row) in self.form_factors.chunks(n).enumerate() {
            let a = self.side[i] as usize;
            let share = self.area[i] / self.sides[a].area;
            for (f, b) in row.iter().zip(&self.side) {
                sums[a * m + *b as usize] += share * f64::from(*f);
            }
        }
        sums
    }
}
