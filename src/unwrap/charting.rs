//! Meshes to charts: flat parts by projection, the others by an unwrapper, whatever that leaves by projection again.

use super::chart::{self, Chart, Proportions};
use super::params::Unwrapper;
use super::part::{Part, Unwrapped};
use super::parts::{self, Parts};
use super::shape::Shape;
use super::{split, uvunwrap, xatlas};
use crate::error::Result;
use crate::progress::Progress;
use crate::store::Key;
use glam::{DVec2, DVec3};
use rayon::prelude::*;
use std::collections::{HashMap, HashSet};

/// Triangles of one call to xatlas, which starts threads each time.
const BATCH_TRIANGLES: usize = 4096;
/// Parts of one call: xatlas queues at most 1024 tasks.
const BATCH_PARTS: usize = 256;

/// A connected part of a mesh that the unwrapper is to chart.
struct Job {
    shape: usize,
    /// The triangles that it sees.
    triangles: Vec<u32>,
    part: Part,
}

/// The charts of each shape, in a fixed order; what `known` has of parts is taken from there, and what is found is put there.
/// `progress` advances by triangles.
///
/// # Errors
/// `Cancelled`.
pub fn charts(
    shapes: &[Shape],
    unwrapper: Unwrapper,
    known: &mut Known,
    progress: &dyn Progress,
) -> Result<Vec<Vec<Chart>>> {
    let prepared: Vec<_> =
        shapes.par_iter().enumerate().map(|(i, shape)| prepare(i, shape, unwrapper, progress)).collect();
    progress.check()?;
    let mut jobs = Vec::new();
    let (mut charts, mut rejected) = (Vec::new(), Vec::new());
    for (flat, left, curved) in prepared {
        charts.push(flat);
        rejected.push(left);
        jobs.extend(curved);
    }
    let unwrapped = unwrap(&jobs, unwrapper, known, progress)?;
    let proportions = match unwrapper {
        Unwrapper::Xatlas => Proportions::Lost,
        Unwrapper::Uvunwrap => Proportions::Kept,
    };
    let finished: Vec<_> = (jobs.par_iter().zip(&unwrapped))
        .map(|(job, unwrapped)| finish(&shapes[job.shape], job, unwrapped, proportions))
        .collect();
    for (job, (curved, left)) in jobs.iter().zip(finished) {
        charts[job.shape].extend(curved);
        rejected[job.shape].extend(left);
    }
    let projected: Vec<_> = rejected.par_iter().zip(shapes).map(|(t, shape)| chart::projected(shape, t)).collect();
    charts.iter_mut().zip(projected).for_each(|(c, p)| c.extend(p));
    Ok(charts)
}

/// What is known of parts: from an earlier atlas, and now.
pub struct Known<'a> {
    pub before: &'a Parts,
    pub now: Parts,
}

/// What the unwrapper makes of each job.
fn unwrap(jobs: &[Job], unwrapper: Unwrapper, known: &mut Known, progress: &dyn Progress) -> Result<Vec<Unwrapped>> {
    let keys: Vec<Key> = jobs.par_iter().map(|job| parts::key(&job.part, unwrapper)).collect();
    let find = |(k, job): (&Key, &Job)| {
        let found = known.before.find(*k).filter(|u| u.chart.len() == job.triangles.len())?;
        progress.advance(job.triangles.len() as u64);
        Some(found.clone())
    };
    let mut unwrapped: Vec<Option<Unwrapped>> = keys.iter().zip(jobs).map(find).collect();
    let left: Vec<usize> = (0..jobs.len()).filter(|&j| unwrapped[j].is_none()).collect();
    let batches = batches(jobs, &left);
    let run = |batch: &Vec<usize>| {
        progress.check()?;
        let parts: Vec<&Part> = batch.iter().map(|&j| &jobs[j].part).collect();
        let unwrapped = match unwrapper {
            Unwrapper::Xatlas => xatlas::unwrap_parts(&parts),
            Unwrapper::Uvunwrap => parts.iter().map(|p| uvunwrap::unwrap_part(p, progress)).collect::<Result<_>>()?,
        };
        progress.advance(batch.iter().map(|&j| jobs[j].triangles.len() as u64).sum());
        Ok(unwrapped)
    };
    let made: Vec<Vec<Unwrapped>> = batches.par_iter().map(run).collect::<Result<_>>()?;
    for (j, made) in batches.concat().into_iter().zip(made.into_iter().flatten()) {
        unwrapped[j] = Some(made);
    }
    let unwrapped: Vec<Unwrapped> = unwrapped.into_iter().map(Option::unwrap_or_default).collect();
    keys.into_iter().zip(&unwrapped).for_each(|(key, made)| known.now.put(key, made.clone()));
    Ok(unwrapped)
}

/// Charts for the flat parts of a mesh, triangles that the unwrapper can't take, and jobs for the rest.
fn prepare(
    index: usize,
    shape: &Shape,
    unwrapper: Unwrapper,
    progress: &dyn Progress,
) -> (Vec<Chart>, Vec<u32>, Vec<Job>) {
    let (mut charts, mut rejected, mut jobs) = (Vec::new(), Vec::new(), Vec::new());
    let parts = shape.parts().into_iter();
    let pieces: Vec<Vec<u32>> = match unwrapper {
        Unwrapper::Xatlas => parts.flat_map(|part| split::pieces(shape, part, split::XATLAS_LIMIT)).collect(),
        Unwrapper::Uvunwrap => (parts.flat_map(|part| split::sheets(shape, part)))
            .flat_map(|part| split::pieces(shape, part, split::UVUNWRAP_LIMIT))
            .collect(),
    };
    for part in pieces {
        if let Some(flat) = chart::planar(shape, &part) {
            charts.extend(flat);
            progress.advance(part.len() as u64);
            continue;
        }
        let job = job(index, shape, &part, &mut rejected);
        progress.advance((part.len() - job.triangles.len()) as u64);
        if !job.triangles.is_empty() {
            jobs.push(job);
        }
    }
    (charts, rejected, jobs)
}

/// A part for the unwrapper: centred, and scaled to a median edge of 1, since epsilons are absolute. Slivers that those would
/// swallow go to `rejected`.
fn job(index: usize, shape: &Shape, triangles: &[u32], rejected: &mut Vec<u32>) -> Job {
    let mut lengths: Vec<f64> = triangles
        .iter()
        .flat_map(|&t| {
            let [a, b, c] = shape.corners(t);
            [a.distance(b), b.distance(c), c.distance(a)]
        })
        .collect();
    let middle = lengths.len() / 2;
    let (_, &mut median, _) = lengths.select_nth_unstable_by(middle, f64::total_cmp);
    let (low, high) = triangles
        .iter()
        .flat_map(|&t| shape.corners(t))
        .fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(low, high), p| (low.min(p), high.max(p)));
    let (center, scale) = (0.5 * (low + high), 1.0 / median);
    let mut job = Job { shape: index, triangles: Vec::new(), part: Part::default() };
    let sliver = |t: u32| {
        let [a, b, c] = shape.corners(t);
        let shortest = a.distance(b).min(b.distance(c)).min(c.distance(a));
        // Well above xatlas' own limits, so that its single precision comes to the same verdict.
        shortest * scale < 4e-4 || shape.area(t) * scale * scale < 1e-6
    };
    let slivers: HashSet<u32> = triangles.iter().filter(|&&t| sliver(t)).map(|&t| shape.polygon[t as usize]).collect();
    let mut number = HashMap::new();
    for &t in triangles {
        if slivers.contains(&shape.polygon[t as usize]) {
            rejected.push(t);
            continue;
        }
        job.triangles.push(t);
        job.part.polygons.push(shape.polygon[t as usize]);
        job.part.triangles.push(shape.mesh.triangles[t as usize].map(|v| {
            let w = shape.welded[v as usize];
            *number.entry(w).or_insert_with(|| {
                job.part.positions.push(((shape.positions[w as usize] - center) * scale).as_vec3().to_array());
                job.part.positions.len() as u32 - 1
            })
        }));
    }
    job
}

/// Those of `jobs` that are `left`, by number, some to each call.
fn batches(jobs: &[Job], left: &[usize]) -> Vec<Vec<usize>> {
    let mut batches: Vec<Vec<usize>> = Vec::new();
    let mut size = usize::MAX;
    for &job in left {
        let next = jobs[job].triangles.len();
        if size.saturating_add(next) > BATCH_TRIANGLES || batches.last().is_none_or(|b| b.len() >= BATCH_PARTS) {
            batches.push(Vec::new());
            size = 0;
        }
        size += next;
        batches.last_mut().expect("just pushed").push(job);
    }
    batches
}

/// The charts of a part from what the unwrapper made of it, and the triangles that it left out or spoilt.
fn finish(shape: &Shape, job: &Job, unwrapped: &Unwrapped, proportions: Proportions) -> (Vec<Chart>, Vec<u32>) {
    let (mut charts, mut rejected) = (Vec::new(), Vec::new());
    let chart_of = whole_polygons(shape, &job.triangles, &unwrapped.chart);
    let mut members: Vec<Vec<usize>> = vec![Vec::new(); unwrapped.chart_count as usize];
    for (i, &c) in chart_of.iter().enumerate() {
        match members.get_mut(c as usize) {
            Some(list) => list.push(i),
            None => rejected.push(job.triangles[i]),
        }
    }
    for list in members.iter_mut().filter(|l| !l.is_empty()) {
        // Polygons that were cut come last, so that they give way where they overlap others.
        let cut: HashSet<u32> = list
            .iter()
            .filter(|&&i| unwrapped.chart[i] != chart_of[i])
            .map(|&i| shape.polygon[job.triangles[i] as usize])
            .collect();
        list.sort_by_key(|&i| cut.contains(&shape.polygon[job.triangles[i] as usize]));
        let triangles: Vec<u32> = list.iter().map(|&i| job.triangles[i]).collect();
        let uv_of = |&i: &usize| (unwrapped.chart[i] == chart_of[i]).then(|| unwrapped.uv[i].map(DVec2::from));
        let uv: Vec<_> = list.iter().map(uv_of).collect();
        charts.extend(chart::flattened(shape, &triangles, &uv, proportions, &mut rejected));
    }
    (charts, rejected)
}

/// One chart for all triangles of a polygon: the one that has most of its area, `u32::MAX` where that was left out.
fn whole_polygons(shape: &Shape, triangles: &[u32], chart: &[u32]) -> Vec<u32> {
    let mut areas: HashMap<u32, Vec<(u32, f64)>> = HashMap::new();
    for (&t, &c) in triangles.iter().zip(chart) {
        let of_polygon = areas.entry(shape.polygon[t as usize]).or_default();
        match of_polygon.iter_mut().find(|(chart, _)| *chart == c) {
            Some((_, area)) => *area += shape.area(t),
            None => of_polygon.push((c, shape.area(t))),
        }
    }
    let largest = |list: &Vec<(u32, f64)>| list.iter().max_by(|a, b| a.1.total_cmp(&b.1)).map_or(u32::MAX, |c| c.0);
    triangles.iter().map(|t| largest(&areas[&shape.polygon[*t as usize]])).collect()
}
