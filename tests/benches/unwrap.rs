//! Unwrappers and packers beside each other on real scenes: `tools/bench --unwrap`, or
//! `cargo bench --ignore-rust-version --bench unwrap -- SCENE ...`. Prints one JSON object a line.
//!
//! Every surface gets a mesh of its own, so that all charts pack freely. `filled` is the area of the surfaces at the density that was
//! reached over that of the page. xatlas packs the very charts that our packer packed, laid flat; its texels per unit are found by
//! bisection, since by itself it opens a second page.
#![allow(unsafe_code)]

#[path = "../atlas/mod.rs"]
mod atlas;
#[path = "../../src/unwrap/xatlas/ffi.rs"]
mod ffi;

use cpu_time::ProcessTime;
use glam::DVec2;
use lumel::progress::Silent;
use lumel::scene::Scene;
use lumel::unwrap::{Atlas, Density, UnwrapParams, Unwrapper, UvMode, unwrap};
use serde_json::json;
use std::collections::BTreeMap;
use std::path::Path;
use std::ptr;

/// Page side and padding [texels] of all runs.
const SIDE: u32 = 1024;
const PADDING: u32 = 2;
/// Random places that xatlas tries for each chart: its default.
const ATTEMPTS: i32 = 4096;
/// Charts that xatlas takes at once: its task queue holds 1024.
const MOST_CHARTS: usize = 1000;
/// Steps of the bisection over xatlas' density.
const STEPS: u32 = 9;

fn main() {
    // SAFETY: xatlas takes a null print function for "print nothing".
    unsafe { ffi::set_print(None, false) };
    for file in std::env::args().skip(1).filter(|a| !a.starts_with("--")) {
        let scene = match lumel::load::load(Path::new(&file)) {
            Ok(loaded) => freed(loaded.scene),
            Err(error) => {
                println!("{}", json!({ "scene": file, "refused": error.to_string() }));
                continue;
            }
        };
        for (name, unwrapper) in [("xatlas", Unwrapper::Xatlas), ("uvunwrap", Unwrapper::Uvunwrap)] {
            measure(&file, &scene, name, unwrapper);
        }
    }
}

/// The scene with a mesh for each surface.
fn freed(mut scene: Scene) -> Scene {
    scene.meshes = scene.surfaces.iter().map(|s| scene.meshes[s.mesh].clone()).collect();
    scene.surfaces.iter_mut().enumerate().for_each(|(s, surface)| surface.mesh = s);
    scene
}

fn measure(file: &str, scene: &Scene, name: &str, unwrapper: Unwrapper) {
    let params = UnwrapParams {
        density: Density::FillPage(SIDE),
        padding: PADDING,
        uv: UvMode::New,
        unwrapper,
        ..UnwrapParams::default()
    };
    let charting = UnwrapParams { density: Density::TexelCount(4096), page_size: 16384, ..params.clone() };
    let clock = ProcessTime::now();
    let charted = unwrap(scene, &charting, &Silent).is_ok();
    let charting_s = clock.elapsed().as_secs_f64();
    let clock = ProcessTime::now();
    let made = unwrap(scene, &params, &Silent);
    let seconds = clock.elapsed().as_secs_f64();
    let (atlas, warnings) = match made {
        Ok(made) => made,
        Err(error) => return println!("{}", json!({ "scene": file, "unwrapper": name, "refused": error.to_string() })),
    };
    let found = atlas::judge(scene, &atlas);
    let clock = ProcessTime::now();
    let packed = xatlas_density(scene, &atlas);
    let packing_s = clock.elapsed().as_secs_f64();
    println!(
        "{}",
        json!({
            "scene": file, "unwrapper": name, "triangles": scene.triangle_count(), "charts": found.charts,
            "shared_texels": found.shared_texels, "near_texels": found.near_texels, "overlap": found.overlap,
            "touched": found.touched, "filled": found.filled, "padding": atlas.padding,
            "stretch_l2": found.stretch_l2, "stretch_max": found.stretch_max,
            "seams": found.seams / found.area.sqrt(), "cpu_s": seconds, "charting_cpu_s": charted.then_some(charting_s),
            "xatlas_filled": packed.map(|d| found.filled * d * d), "xatlas_packing_cpu_s": packed.map(|_| packing_s),
            "warnings": warnings.iter().count(),
        })
    );
}

/// The most texels per texel of ours at which xatlas packs the same charts on one page of the same size and padding.
fn xatlas_density(scene: &Scene, ours: &Atlas) -> Option<f64> {
    let mut charts: BTreeMap<(usize, u32), Vec<[DVec2; 3]>> = BTreeMap::new();
    for (s, surface) in scene.surfaces.iter().enumerate() {
        for (t, &chart) in ours.meshes[surface.mesh].chart.iter().enumerate() {
            let corners = ours.page_texels(s, surface.mesh, t).map(|p| p.as_dvec2());
            charts.entry((s, chart)).or_default().push(corners);
        }
    }
    if charts.len() > MOST_CHARTS || ours.padding != PADDING {
        return None;
    }
    // Each chart in a plane of its own, so that none touches another.
    let mut positions: Vec<[f32; 3]> = Vec::new();
    let mut indices: Vec<u32> = Vec::new();
    for (number, triangles) in charts.values().enumerate() {
        let mut known: BTreeMap<[u64; 2], u32> = BTreeMap::new();
        for p in triangles.iter().flatten() {
            let next = positions.len() as u32;
            let index = *known.entry(p.to_array().map(f64::to_bits)).or_insert(next);
            if index == next {
                positions.push([p.x as f32, p.y as f32, 10.0 * number as f32]);
            }
            indices.push(index);
        }
    }
    let declaration = ffi::MeshDecl {
        vertex_count: positions.len() as u32,
        position_data: positions.as_ptr().cast(),
        position_stride: size_of::<[f32; 3]>() as u32,
        normal_data: ptr::null(),
        normal_stride: 0,
        uv_data: ptr::null(),
        uv_stride: 0,
        index_count: indices.len() as u32,
        index_data: indices.as_ptr().cast(),
        index_offset: 0,
        index_format: ffi::INDEX_U32,
        face_ignore: ptr::null(),
    };
    // SAFETY: the declaration's pointers and counts describe vectors that outlive the calls, which are in the order that xatlas
    // asks for. The atlas is left to the end of the process: destroying one has a race.
    unsafe {
        let atlas = ffi::create();
        if ffi::add_mesh(atlas, &declaration) != ffi::ADD_MESH_SUCCESS {
            return None;
        }
        ffi::compute_charts(atlas, ffi::ChartOptions::default(), None, ptr::null_mut());
        ffi::parameterize_charts(atlas, None, None, ptr::null_mut());
        let fits = |texels_per_unit: f64| {
            let options = ffi::PackOptions {
                attempts: ATTEMPTS,
                texels_per_unit: texels_per_unit as f32,
                resolution: SIDE,
                max_chart_size: SIDE - 2 * PADDING,
                block_align: false,
                conservative: true,
                padding: PADDING,
            };
            ffi::pack_charts(atlas, options, None, ptr::null_mut());
            (*atlas).atlas_count == 1
        };
        let (mut low, mut high) = (0.5, 1.3);
        for _ in 0..STEPS {
            let middle = 0.5 * (low + high);
            if fits(middle) { low = middle } else { high = middle }
        }
        Some(low)
    }
}
