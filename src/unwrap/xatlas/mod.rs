//! xatlas by way of the C++ library that the `xatlas-rs` crate builds.
//!
//! The crate's own bindings are mangled for MSVC and don't link elsewhere, so the few functions that are needed are declared in
//! [`ffi`] against its `vendor/xatlas.h`. xatlas charts a mesh by growing regions of like normals, and flattens each chart by
//! least squares conformal maps (Lévy et al. 2002). Its packer is made to do next to nothing, since [`super::pack`] packs:
//! every chart is squeezed into one texel, so a chart's UVs come back scaled to its bounding box and lose their aspect ratio,
//! which [`super::chart`] finds again.
//!
//! Limits: lengths below 1e-4 and areas below 1e-7 count as zero in absolute terms, so callers scale their input to edges of
//! about 1. Charting costs more than linearly in the charts of one connected part.

#![allow(unsafe_code)]

mod ffi;

use super::part::{Part, Unwrapped};
use ffi::{
    ADD_MESH_SUCCESS, ChartOptions, INDEX_U32, MeshDecl, OutputAtlas, OutputMesh, PackOptions, add_mesh,
    compute_charts, create, destroy, pack_charts, parameterize_charts, set_print,
};
use std::ptr;
use std::sync::Once;

/// Texels per unit: so many that most charts are larger than a texel and are scaled down to just one, so few that the page that
/// xatlas makes for them all stays small.
const DENSE: f32 = 64.0;

/// Side of xatlas' own pages [texels]: given, or it would work out a page for that density.
const PAGE: u32 = 256;

/// Charts and flattens `parts`; each chart comes scaled to a unit square somewhere, and may be mirrored. Equal input gives equal bits: xatlas seeds its own random numbers for each part.
pub fn unwrap_parts(parts: &[&Part]) -> Vec<Unwrapped> {
    static QUIET: Once = Once::new();
    // SAFETY: xatlas takes a null print function for "print nothing"; `Once` keeps the write of its global single.
    QUIET.call_once(|| unsafe { set_print(None, false) });

    let mut result: Vec<_> = parts.iter().map(|part| Unwrapped::none(part.triangles.len())).collect();
    // SAFETY: no arguments; the atlas is handed to `Doomed`, which destroys it once.
    let atlas = Doomed(unsafe { create() });
    let mut added = Vec::with_capacity(parts.len());
    for (i, part) in parts.iter().enumerate() {
        if part.triangles.is_empty() || part.triangles.iter().flatten().any(|&v| v as usize >= part.positions.len()) {
            continue;
        }
        let declaration = MeshDecl {
            vertex_count: part.positions.len() as u32,
            position_data: part.positions.as_ptr().cast(),
            position_stride: size_of::<[f32; 3]>() as u32,
            normal_data: ptr::null(),
            normal_stride: 0,
            uv_data: ptr::null(),
            uv_stride: 0,
            index_count: part.triangles.len() as u32 * 3,
            index_data: part.triangles.as_ptr().cast(),
            index_offset: 0,
            index_format: INDEX_U32,
            face_ignore: ptr::null(),
        };
        // SAFETY: the declaration's pointers and counts describe `part`'s vectors, which outlive the call (it copies).
        if unsafe { add_mesh(atlas.0, &declaration) } == ADD_MESH_SUCCESS {
            added.push(i);
        }
    }
    if added.is_empty() {
        return result;
    }
    let options = PackOptions {
        attempts: 1,
        texels_per_unit: DENSE,
        resolution: PAGE,
        max_chart_size: 1,
        block_align: false,
        conservative: false,
        padding: 0,
    };
    // SAFETY: the atlas is alive and holds at least one mesh, the calls are in the order that xatlas asks for, and the
    // function pointers are null, which it allows. Options are passed by value as repr(C) copies of trivial C++ structs.
    unsafe {
        compute_charts(atlas.0, ChartOptions::default(), None, ptr::null_mut());
        parameterize_charts(atlas.0, None, None, ptr::null_mut());
        pack_charts(atlas.0, options, None, ptr::null_mut());
    }
    // SAFETY: PackCharts has filled `meshes` with `mesh_count` entries; both stay until the atlas is destroyed.
    let meshes = unsafe { slice((*atlas.0).meshes, (*atlas.0).mesh_count) };
    for (mesh, &i) in meshes.iter().zip(&added) {
        // SAFETY: `mesh` is one of the atlas' output meshes, and the atlas is still alive.
        unsafe { copy_out(mesh, parts[i], &mut result[i]) };
    }
    result
}

/// Copies an output mesh.
///
/// # Safety
/// `mesh` must be an output mesh of a living atlas after PackCharts.
unsafe fn copy_out(mesh: &OutputMesh, part: &Part, out: &mut Unwrapped) {
    // SAFETY: each array of an output mesh has the length that stands beside it.
    let (vertices, indices, charts) = unsafe {
        (
            slice(mesh.vertices, mesh.vertex_count),
            slice(mesh.indices, mesh.index_count),
            slice(mesh.charts, mesh.chart_count),
        )
    };
    let mut chart_of_vertex = vec![u32::MAX; vertices.len()];
    for (c, chart) in charts.iter().enumerate() {
        // SAFETY: as above, for the chart's indices.
        for &v in unsafe { slice(chart.indices, chart.index_count) } {
            chart_of_vertex[v as usize] = c as u32;
        }
    }
    out.chart_count = charts.len() as u32;
    if indices.len() != part.triangles.len() * 3 {
        return;
    }
    for (t, corners) in indices.chunks_exact(3).enumerate() {
        let sound = corners.iter().zip(&part.triangles[t]).all(|(&v, &source)| {
            vertices.get(v as usize).is_some_and(|x| x.xref == source)
                && chart_of_vertex[v as usize] == chart_of_vertex[corners[0] as usize]
        });
        if sound {
            out.chart[t] = chart_of_vertex[corners[0] as usize];
            out.uv[t] = [0, 1, 2].map(|k| vertices[corners[k] as usize].uv.map(f64::from));
        }
    }
}

/// A slice of a C array, empty for a null pointer.
///
/// # Safety
/// `data` must be null or point to `count` values that live for `'a`.
unsafe fn slice<'a, T>(data: *const T, count: u32) -> &'a [T] {
    if data.is_null() || count == 0 {
        return &[];
    }
    // SAFETY: the caller's promise.
    unsafe { std::slice::from_raw_parts(data, count as usize) }
}

/// An atlas that is destroyed on a thread of its own: stopping xatlas' task threads has a race (a worker that is about to
/// sleep can miss the last wake-up) that would, very rarely, block the caller for ever.
struct Doomed(*mut OutputAtlas);

impl Drop for Doomed {
    fn drop(&mut self) {
        let address = self.0 as usize;
        // Where no thread can be had, the atlas leaks.
        let _ = std::thread::Builder::new().spawn(move || {
            // SAFETY: the address is the atlas' own, its only owner is being dropped, and it isn't bound to a thread.
            unsafe { destroy(address as *mut OutputAtlas) };
        });
    }
}
