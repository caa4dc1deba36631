//! xatlas by way of the C++ library that the `xatlas-rs` crate builds.
//!
//! The crate's own bindings are mangled for MSVC and don't link elsewhere, so the few functions that are needed are declared
//! here against its `vendor/xatlas.h`. xatlas charts a mesh by growing regions of like normals, and flattens each chart by
//! least squares conformal maps (Lévy et al. 2002). Its packer is made to do next to nothing, since [`super::pack`] packs:
//! every chart is squeezed into one texel, so a chart's UVs come back scaled to its bounding box and lose their aspect ratio,
//! which [`super::chart`] finds again.
//!
//! Limits: lengths below 1e-4 and areas below 1e-7 count as zero in absolute terms, so callers scale their input to edges of
//! about 1. Charting costs more than linearly in the charts of one connected part.

#![allow(unsafe_code)]

use std::ffi::{c_int, c_void};
use std::ptr;
use std::sync::Once;

// Links the C++ library; nothing of the crate's Rust side is used.
extern crate xatlas_rs as _;

/// A connected mesh for [`unwrap_parts`].
#[derive(Clone, Debug, Default)]
pub struct Part {
    /// Vertex positions; those of one place share one vertex. Edges are about 1 long.
    pub positions: Vec<[f32; 3]>,
    /// Vertex indices, all in range.
    pub triangles: Vec<[u32; 3]>,
}

/// What xatlas makes of a [`Part`].
#[derive(Clone, Debug, Default)]
pub struct Unwrapped {
    /// The chart of each triangle, or `u32::MAX` where xatlas left it out.
    pub chart: Vec<u32>,
    pub chart_count: u32,
    /// UVs of each triangle's corners; each chart is scaled to a unit square somewhere, and may be mirrored.
    pub uv: Vec<[[f32; 2]; 3]>,
}

/// Texels per unit: so many that most charts are larger than a texel and are scaled down to just one, so few that the page that
/// xatlas makes for them all stays small.
const DENSE: f32 = 64.0;

/// Side of xatlas' own pages [texels]: given, or it would work out a page for that density.
const PAGE: u32 = 256;

/// Charts and flattens `parts`. Equal input gives equal bits: xatlas seeds its own random numbers for each part.
pub fn unwrap_parts(parts: &[Part]) -> Vec<Unwrapped> {
    static QUIET: Once = Once::new();
    // SAFETY: xatlas takes a null print function for "print nothing"; `Once` keeps the write of its global single.
    QUIET.call_once(|| unsafe { set_print(None, false) });

    let empty = |part: &Part| Unwrapped {
        chart: vec![u32::MAX; part.triangles.len()],
        chart_count: 0,
        uv: vec![[[0.0; 2]; 3]; part.triangles.len()],
    };
    let mut result: Vec<_> = parts.iter().map(empty).collect();
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
        unsafe { copy_out(mesh, &parts[i], &mut result[i]) };
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
            out.uv[t] = [0, 1, 2].map(|k| vertices[corners[k] as usize].uv);
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

// The structs of vendor/xatlas.h of xatlas-rs 0.1.3.

#[repr(C)]
struct OutputChart {
    atlas_index: u32,
    indices: *mut u32,
    index_count: u32,
}

#[repr(C)]
struct OutputVertex {
    atlas_index: i32,
    uv: [f32; 2],
    xref: u32,
}

#[repr(C)]
struct OutputMesh {
    charts: *mut OutputChart,
    chart_count: u32,
    indices: *mut u32,
    index_count: u32,
    vertices: *mut OutputVertex,
    vertex_count: u32,
}

#[repr(C)]
struct OutputAtlas {
    width: u32,
    height: u32,
    atlas_count: u32,
    chart_count: u32,
    mesh_count: u32,
    meshes: *mut OutputMesh,
    utilization: *mut f32,
    texels_per_unit: f32,
}

#[repr(C)]
struct MeshDecl {
    vertex_count: u32,
    position_data: *const c_void,
    position_stride: u32,
    normal_data: *const c_void,
    normal_stride: u32,
    uv_data: *const c_void,
    uv_stride: u32,
    index_count: u32,
    index_data: *const c_void,
    index_offset: i32,
    index_format: c_int,
    face_ignore: *const bool,
}

const INDEX_U32: c_int = 1;
const ADD_MESH_SUCCESS: c_int = 0;

#[repr(C)]
#[derive(Clone, Copy)]
struct ChartOptions {
    max_chart_area: f32,
    max_boundary_length: f32,
    proxy_fit_metric_weight: f32,
    roundness_metric_weight: f32,
    straightness_metric_weight: f32,
    normal_seam_metric_weight: f32,
    texture_seam_metric_weight: f32,
    max_threshold: f32,
    grow_face_count: u32,
    max_iterations: u32,
}

impl Default for ChartOptions {
    /// The header's own defaults.
    fn default() -> Self {
        Self {
            max_chart_area: 0.0,
            max_boundary_length: 0.0,
            proxy_fit_metric_weight: 2.0,
            roundness_metric_weight: 0.01,
            straightness_metric_weight: 6.0,
            normal_seam_metric_weight: 4.0,
            texture_seam_metric_weight: 0.5,
            max_threshold: 2.0,
            grow_face_count: 32,
            max_iterations: 1,
        }
    }
}

#[repr(C)]
#[derive(Clone, Copy)]
struct PackOptions {
    attempts: c_int,
    texels_per_unit: f32,
    resolution: u32,
    max_chart_size: u32,
    block_align: bool,
    conservative: bool,
    padding: u32,
}

type ProgressFn = Option<unsafe extern "C" fn(c_int, c_int, *mut c_void)>;
type ParameterizeFn = Option<unsafe extern "C" fn(*const f32, *mut f32, u32, *const u32, u32, bool)>;
type PrintFn = Option<unsafe extern "C" fn(*const std::ffi::c_char, ...) -> c_int>;

unsafe extern "C" {
    #[link_name = "_ZN6xatlas6CreateEv"]
    fn create() -> *mut OutputAtlas;
    #[link_name = "_ZN6xatlas7DestroyEPNS_5AtlasE"]
    fn destroy(atlas: *mut OutputAtlas);
    #[link_name = "_ZN6xatlas7AddMeshEPNS_5AtlasERKNS_8MeshDeclE"]
    fn add_mesh(atlas: *mut OutputAtlas, declaration: *const MeshDecl) -> c_int;
    #[link_name = "_ZN6xatlas13ComputeChartsEPNS_5AtlasENS_12ChartOptionsEPFvNS_16ProgressCategory4EnumEiPvES5_"]
    fn compute_charts(atlas: *mut OutputAtlas, options: ChartOptions, progress: ProgressFn, user: *mut c_void);
    #[link_name = "_ZN6xatlas18ParameterizeChartsEPNS_5AtlasEPFvPKfPfjPKjjbEPFvNS_16ProgressCategory4EnumEiPvESB_"]
    fn parameterize_charts(atlas: *mut OutputAtlas, function: ParameterizeFn, progress: ProgressFn, user: *mut c_void);
    #[link_name = "_ZN6xatlas10PackChartsEPNS_5AtlasENS_11PackOptionsEPFvNS_16ProgressCategory4EnumEiPvES5_"]
    fn pack_charts(atlas: *mut OutputAtlas, options: PackOptions, progress: ProgressFn, user: *mut c_void);
    #[link_name = "_ZN6xatlas8SetPrintEPFiPKczEb"]
    fn set_print(print: PrintFn, verbose: bool);
}
