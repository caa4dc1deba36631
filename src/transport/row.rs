//! Rows of form factors, computed when they are first asked for and kept as sparse links as long as memory allows.

use super::hemicube::{Hemicube, HemicubeParams};
use super::outline::Outlines;
use super::{Effort, Elements, Exchanger, Method, Probes, analytic, area, near};
use crate::Result;
use crate::color::Rgb;
use crate::patch::Ground;
use crate::progress::Progress;
use rayon::prelude::*;
use std::sync::{Arc, OnceLock};

/// Links that are kept, 8 bytes each; rows beyond are thrown away and computed anew each time.
const MOST_KEPT: u64 = 1 << 29;

/// How form factors between elements are found.
#[derive(Clone, Debug)]
pub struct TransportParams {
    pub method: Method,
    pub effort: Effort,
    pub hemicube: HemicubeParams,
    /// Rays that probe each element; a power of two.
    pub probe_rays: u32,
}

/// The matrix F, row by row.
pub struct Rows<'a> {
    elements: &'a Elements,
    ground: &'a Ground<'a>,
    probes: &'a Probes<'a>,
    params: TransportParams,
    outlines: Outlines<'a>,
    hemicube: OnceLock<Hemicube>,
    rows: Vec<Option<Arc<Row>>>,
    /// Links that are kept.
    kept: u64,
    /// True once all rows are there.
    is_complete: bool,
    /// Segments that were traced.
    pub segments: u64,
}

/// Form factors from one element to all that it sees.
#[derive(Clone, Debug, Default)]
pub struct Row {
    /// Elements, ascending, and the form factors to them as estimated; symmetric in `A_i F_ij`.
    pub links: Vec<(u32, f32)>,
    /// What all of them are multiplied by, so that their sum is what the element's probe saw land: in a closed scene exactly
    /// 1, and no power is made or lost by the noise of single form factors.
    pub scale: f32,
}

/// What a row that adds up to `sum` is multiplied by, where a share `landed` of the element's probe rays landed.
pub fn closure(method: Method, sum: f64, landed: impl FnOnce() -> f32) -> f64 {
    match method {
        Method::Area if sum > 0.0 => f64::from(landed()) / sum,
        // It knows no occluders: what stands in front of something else must not make light.
        Method::Analytic if sum > 1.0 => 1.0 / sum,
        _ => 1.0,
    }
}

impl Row {
    /// The form factor to element `j`.
    pub fn to(&self, j: usize) -> f32 {
        self.estimate(j) * self.scale
    }

    /// Irradiance by what all elements send [lx].
    pub fn gather(&self, sent: &[Rgb]) -> Rgb {
        self.links.iter().map(|&(j, f)| sent[j as usize] * f).sum::<Rgb>() * self.scale
    }

    fn estimate(&self, j: usize) -> f32 {
        self.links.binary_search_by_key(&(j as u32), |l| l.0).map_or(0.0, |k| self.links[k].1)
    }
}

impl Exchanger for Rows<'_> {
    fn gather(&mut self, sent: &[Rgb], progress: &dyn Progress) -> Result<Vec<Rgb>> {
        self.complete(progress)?;
        if self.is_complete {
            return Ok(self.rows.par_iter().map(|row| row.as_ref().map_or(Rgb::ZERO, |r| r.gather(sent))).collect());
        }
        (0..self.elements.len())
            .map(|i| {
                progress.check()?;
                Ok(self.row(i).gather(sent))
            })
            .collect()
    }
}

impl<'a> Rows<'a> {
    /// Nothing is computed yet. Memory: 8 bytes for each pair that sees itself, once all rows are there.
    pub fn new(
        elements: &'a Elements,
        ground: &'a Ground<'a>,
        probes: &'a Probes<'a>,
        params: TransportParams,
    ) -> Self {
        let n = elements.len();
        let (outlines, rows) = (Outlines::new(elements, ground), vec![None; n]);
        Self {
            elements,
            ground,
            probes,
            params,
            outlines,
            hemicube: OnceLock::new(),
            rows,
            kept: 0,
            is_complete: false,
            segments: 0,
        }
    }

    /// Form factors from element `i` to every element.
    pub fn row(&mut self, i: usize) -> Arc<Row> {
        if let Some(row) = &self.rows[i] {
            return row.clone();
        }
        let (links, segments) = self.links(i, 0);
        self.segments += segments;
        let row = Arc::new(self.scaled(i, links));
        self.keep(i, &row);
        row
    }

    /// The row of element `i` where it is kept.
    pub fn kept(&self, i: usize) -> Option<&Row> {
        self.rows[i].as_deref()
    }

    /// Computes all rows, each pair once, where there is memory for them.
    ///
    /// # Errors
    /// `Cancelled`.
    pub fn complete(&mut self, progress: &dyn Progress) -> Result<()> {
        let n = self.elements.len();
        // Each element may see all others.
        if self.is_complete || (n as u64).pow(2) > MOST_KEPT {
            return Ok(());
        }
        let upper: Vec<(Vec<(u32, f32)>, u64)> = (0..n)
            .into_par_iter()
            .map(|i| {
                progress.check()?;
                progress.advance(1);
                Ok(self.links(i, i))
            })
            .collect::<Result<_>>()?;
        let symmetric = matches!(self.params.method, Method::Area | Method::Analytic);
        let mut all: Vec<Vec<(u32, f32)>> = vec![Vec::new(); n];
        for (i, (links, segments)) in upper.into_iter().enumerate() {
            self.segments += segments;
            if symmetric {
                for &(j, f) in links.iter().filter(|l| l.0 as usize != i) {
                    let ratio = self.elements.area[i] / self.elements.area[j as usize];
                    all[j as usize].push((i as u32, f * ratio));
                }
            }
            all[i].extend(links);
        }
        for (i, mut links) in all.into_iter().enumerate() {
            links.shrink_to_fit();
            let row = Arc::new(self.scaled(i, links));
            self.keep(i, &row);
        }
        self.is_complete = true;
        Ok(())
    }

    fn keep(&mut self, i: usize, row: &Arc<Row>) {
        if self.rows[i].is_none() && self.kept + row.links.len() as u64 <= MOST_KEPT {
            self.kept += row.links.len() as u64;
            self.rows[i] = Some(row.clone());
        }
    }

    fn scaled(&self, i: usize, links: Vec<(u32, f32)>) -> Row {
        let sum: f64 = links.iter().map(|l| f64::from(l.1)).sum();
        let scale = closure(self.params.method, sum, || self.probes.of(i).landed_share);
        Row { links, scale: scale as f32 }
    }

    /// The form factors from element `i` to elements from `first` on (to all where a row is found at once), and the segments
    /// they took.
    fn links(&self, i: usize, first: usize) -> (Vec<(u32, f32)>, u64) {
        match self.params.method {
            Method::Area | Method::Analytic => {
                let pairs: Vec<(f32, u32)> =
                    (first..self.elements.len()).into_par_iter().with_min_len(32).map(|j| self.pair(i, j)).collect();
                let segments = pairs.iter().map(|p| u64::from(p.1)).sum();
                let links = (first as u32..).zip(pairs).filter(|(_, p)| p.0 > 0.0).map(|(j, p)| (j, p.0)).collect();
                (links, segments)
            }
            Method::Hemisphere => (self.probes.of(i).landed.clone(), 0),
            Method::Hemicube => {
                // Its tables are made once; what it draws into is each row's own.
                let mut cube = self.hemicube.get_or_init(|| Hemicube::new(&self.params.hemicube)).clone();
                (cube.row(self.elements, self.ground, i), 0)
            }
        }
    }

    /// The form factor from `i` to `j`, and the segments it took.
    fn pair(&self, i: usize, j: usize) -> (f32, u32) {
        if i == j {
            // Flat ones don't see themselves; without rays nothing is known of the others.
            let seen = if self.params.method == Method::Analytic { 0.0 } else { self.probes.between(i, i).value };
            return (seen as f32, 0);
        }
        let ratio = self.elements.area[j] / self.elements.area[i];
        if let Some(other) = &self.rows[j] {
            return (other.estimate(i) * ratio, 0);
        }
        let [a, b] = [i, j].map(|e| &self.elements.cluster[e]);
        if !a.can_see(b) {
            return (0.0, 0);
        }
        let effort = &self.params.effort;
        let most = a.most_form_factor(b);
        let outlines = || [i, j].map(|e| self.outlines.of(e));
        let is_near = self.elements.are_near(i, j);
        let f = match self.params.method {
            Method::Analytic => analytic::form_factor(self.elements, i, j, outlines(), effort),
            _ if is_near && !near::is_quick(outlines()) => self.probes.between(i, j),
            _ if is_near => near::form_factor(self.elements, self.ground, i, j, outlines(), effort),
            _ if effort.is_small(most) => area::glance(self.elements, self.ground, i, j, most, effort),
            _ => area::form_factor(self.elements, self.ground, i, j, effort),
        };
        // The quadrature's points are no segments.
        let segments = if self.params.method == Method::Analytic { 0 } else { f.samples };
        (f.value as f32, segments)
    }
}
