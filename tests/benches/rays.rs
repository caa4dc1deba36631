//! Rays a second, beside Embree's on the same rays in the same process.
//!
//!     cargo bench --bench rays -- SCENE [--embree LIBRARY] [--rounds N] [--only KIND]
//!
//! For each kind of ray, closest and any hit, one thread and two: millions of rays a second, by processor time, from the least
//! time of each section in N rounds in which all take turns; Embree's by single rays and by packets of 16; ours over its single
//! rays; and the share of rays on which both agree (coincident surfaces and backs, which count as farther here, part them).
//! Embree is built robust and at high quality. Without a library ours stand alone.

mod embree;

use cpu_time::ProcessTime;
use embree::{Embree, Span};
use glam::Vec3;
use lumel::sample::sequence::Stage;
use lumel::sample::warp::{cosine_hemisphere, frame, triangle};
use lumel::sample::{Discrete, Sequence};
use lumel::scene::Scene;
use lumel::trace::{Hit, Ray, Segment, Tracer};
use rayon::prelude::*;
use std::ops::Range;
use std::path::PathBuf;
use std::time::Instant;

/// Points on surfaces, and rays from each: a receiver's batch.
const POINTS: usize = 4096;
const BATCH: usize = 64;
/// Rays that are timed at once: what disturbs one section leaves the others' least times alone.
const SECTION: usize = 128 * BATCH;
/// Side of the camera's picture.
const PICTURE: usize = 512;

struct Kind {
    name: &'static str,
    spans: Vec<Span>,
}

fn main() {
    let mut arguments = std::env::args().skip(1).filter(|a| a != "--bench");
    let (mut scene, mut library, mut rounds, mut only) = (None, None, 5, String::new());
    while let Some(argument) = arguments.next() {
        match argument.as_str() {
            "--embree" => library = arguments.next().map(PathBuf::from),
            "--rounds" => rounds = arguments.next().and_then(|n| n.parse().ok()).expect("--rounds takes a count"),
            "--only" => only = arguments.next().expect("--only takes a kind of ray"),
            _ => scene = Some(PathBuf::from(argument)),
        }
    }
    let Some(scene) = scene else { return println!("usage: cargo bench --bench rays -- SCENE [--embree LIBRARY]") };
    let scene = lumel::load::load(&scene).expect("a scene that loads").scene;
    let (tracer, build) = timed(|| Tracer::new(&scene));
    println!("{} triangles, hierarchy built in {build:.2} s", tracer.triangle_count());
    let corners = corners(&scene, &tracer);
    let embree = library.map(|path| {
        let (embree, build) = timed(|| Embree::new(&path, &corners).expect("Embree 4"));
        println!("Embree's built in {build:.2} s");
        embree
    });
    println!("Mray/s                threads    lumel   Embree  its packets   ratio   agree");
    for kind in kinds(&corners, tracer.offset()).iter().filter(|k| k.name.contains(&only)) {
        for threads in [1, 2] {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("threads");
            pool.install(|| compare(kind, threads, rounds, &tracer, embree.as_ref()));
        }
    }
}

fn timed<T>(work: impl FnOnce() -> T) -> (T, f64) {
    let start = Instant::now();
    let result = work();
    (result, start.elapsed().as_secs_f64())
}

/// The world corners of each triangle number.
fn corners(scene: &Scene, tracer: &Tracer) -> Vec<[[f32; 3]; 3]> {
    let place = |n| tracer.place(n as u32);
    (0..tracer.triangle_count()).map(place).map(|(s, t)| scene.world_triangle(s, t).map(|p| p.to_array())).collect()
}

/// Camera, gather and shadow rays, and the gather rays shuffled.
fn kinds(corners: &[[[f32; 3]; 3]], offset: f32) -> Vec<Kind> {
    let corners: Vec<[Vec3; 3]> = corners.iter().map(|t| t.map(Vec3::from)).collect();
    let area = |[a, b, c]: &[Vec3; 3]| f64::from((*b - *a).cross(*c - *a).length());
    let by_area = Discrete::new(corners.iter().map(area)).expect("triangles with an area");
    let picks = Sequence::new(0, Stage::Gather, u64::MAX);
    // A point off a triangle's front, and the normal there.
    let point = |index: usize| {
        let [choice, x, y, _] = picks.point(index as u32, 0);
        let [a, b, c] = corners[by_area.sample(choice).0];
        let weights = triangle([x, y]);
        let normal = (b - a).cross(c - a).normalize();
        (a + (b - a) * weights.x + (c - a) * weights.y + normal * offset, normal)
    };
    let span = |origin: Vec3, direction: Vec3, length: f32| Span {
        origin: origin.to_array(),
        direction: direction.to_array(),
        length,
    };
    let gather: Vec<Span> = (0..POINTS)
        .flat_map(|p| {
            let (origin, normal) = point(p);
            let sequence = Sequence::new(0, Stage::Gather, p as u64);
            (0..BATCH).map(move |i| {
                let [x, y, ..] = sequence.point(i as u32, 0);
                span(origin, frame(normal) * cosine_hemisphere([x, y]), f32::INFINITY)
            })
        })
        .collect();
    let shadow = (0..POINTS)
        .flat_map(|p| {
            let (from, normal) = point(p);
            // From some points, on the outside, there is nothing ahead.
            (0..4 * BATCH)
                .map(move |i| point(POINTS + p * BATCH / 4 + i).0 - from)
                .filter(move |way| way.dot(normal) > 0.0)
                .take(BATCH)
                .map(move |way| span(from, way / way.length(), way.length()))
        })
        .collect();
    let (low, high) = corners.iter().flatten().fold((Vec3::MAX, Vec3::MIN), |(l, h), p| (l.min(*p), h.max(*p)));
    let eye = (low + high) / 2.0;
    let camera = (0..PICTURE * PICTURE)
        .map(|i| {
            // By tiles of a batch.
            let (tile, within) = (i / BATCH, i % BATCH);
            let (tiles, side) = (PICTURE / 8, 8);
            let [x, y] = [tile % tiles * side + within % side, tile / tiles * side + within / side]
                .map(|p| 2.0 * (p as f32 + 0.5) / PICTURE as f32 - 1.0);
            span(eye, Vec3::new(1.0, -y, x).normalize(), f32::INFINITY)
        })
        .collect();
    let mut shuffled = gather.clone();
    for i in (1..shuffled.len()).rev() {
        shuffled.swap(i, picks.hash(i as u32) as usize % (i + 1));
    }
    [("camera", camera), ("gather", gather), ("shadow", shadow), ("shuffled", shuffled)]
        .map(|(name, spans)| Kind { name, spans })
        .into()
}

/// Prints two lines, closest and any hit.
fn compare(kind: &Kind, threads: usize, rounds: usize, tracer: &Tracer, embree: Option<&Embree>) {
    let spans = &kind.spans[..];
    let rays: Vec<Ray> = spans.iter().map(|s| Ray { origin: s.origin.into(), direction: s.direction.into() }).collect();
    let segments: Vec<Segment> = rays
        .iter()
        .zip(spans)
        .map(|(r, s)| Segment { from: r.origin, to: r.origin + r.direction * s.length })
        .collect();

    let endless: Vec<Span> = spans.iter().map(|s| Span { length: f32::INFINITY, ..*s }).collect();
    let mut hits: Vec<Option<Hit>> = vec![None; rays.len()];
    let mut theirs: [Vec<Option<u32>>; 2] = std::array::from_fn(|_| vec![None; rays.len()]);
    let times = race(rays.len(), rounds, |section| {
        let (endless, [singles, packets]) = (&endless[section.clone()], theirs.each_mut());
        [
            batches(&rays[section.clone()], &mut hits[section.clone()], |r, h| tracer.closest(r, h)),
            embree.map_or(f64::INFINITY, |e| batches(endless, &mut singles[section.clone()], |s, h| e.closest(s, h))),
            embree.map_or(f64::INFINITY, |e| batches(endless, &mut packets[section], |s, h| e.closest16(s, h))),
        ]
    });
    let agree = hits.iter().zip(&theirs[0]).filter(|(a, b)| a.map(|h| h.triangle) == **b).count();
    show(kind, "closest", threads, times, agree);

    let mut blocked = vec![false; rays.len()];
    let mut theirs = [blocked.clone(), blocked.clone()];
    let whole = spans[0].length == f32::INFINITY;
    let times = race(rays.len(), rounds, |section| {
        let (spans, [singles, packets]) = (&spans[section.clone()], theirs.each_mut());
        let blocked = &mut blocked[section.clone()];
        [
            if whole {
                batches(&rays[section.clone()], blocked, |r, b| tracer.occluded_rays(r, b))
            } else {
                batches(&segments[section.clone()], blocked, |s, b| tracer.occluded(s, b))
            },
            embree.map_or(f64::INFINITY, |e| batches(spans, &mut singles[section.clone()], |s, b| e.occluded(s, b))),
            embree.map_or(f64::INFINITY, |e| batches(spans, &mut packets[section], |s, b| e.occluded16(s, b))),
        ]
    });
    let agree = blocked.iter().zip(&theirs[0]).filter(|(a, b)| a == b).count();
    show(kind, "any", threads, times, agree);
}

/// Seconds of each in a race over `count` rays: the least time of each section, added up.
fn race<const N: usize>(count: usize, rounds: usize, mut run: impl FnMut(Range<usize>) -> [f64; N]) -> [f64; N] {
    let sections = || (0..count).step_by(SECTION).map(|start| start..(start + SECTION).min(count));
    let mut least = vec![[f64::INFINITY; N]; sections().len()];
    for _ in 0..rounds {
        for (section, least) in sections().zip(&mut least) {
            for (least, time) in least.iter_mut().zip(run(section)) {
                *least = least.min(time);
            }
        }
    }
    std::array::from_fn(|i| least.iter().map(|times| times[i]).sum())
}

/// Seconds that `query` takes for all of `queries`, by batches, over the pool's threads: of processor time, which others on the
/// machine disturb less; the lesser of two runs, as the first finds the caches full of the others' trees.
fn batches<Q: Sync, A: Send>(queries: &[Q], answers: &mut [A], query: impl Fn(&[Q], &mut [A]) + Sync) -> f64 {
    let mut run = || {
        let start = ProcessTime::now();
        queries.par_chunks(BATCH).zip(answers.par_chunks_mut(BATCH)).for_each(|(q, a)| query(q, a));
        start.elapsed().as_secs_f64() / rayon::current_num_threads() as f64
    };
    run().min(run())
}

fn show(kind: &Kind, query: &str, threads: usize, [time, single, packets]: [f64; 3], agree: usize) {
    let rate = |seconds: f64| kind.spans.len() as f64 / seconds / 1e6;
    print!("{:<9} {query:<8} {threads:>9} {:>11.2}", kind.name, rate(time));
    if single < f64::INFINITY {
        let share = 100.0 * agree as f64 / kind.spans.len() as f64;
        print!(" {:>8.2} {:>12.2} {:>7.2} {share:>6.2}%", rate(single), rate(packets), single / time);
    }
    println!();
}
