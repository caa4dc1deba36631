//! The structs and functions of `vendor/xatlas.h` of xatlas-rs 0.1.3 that are used. Its packer is measured by
//! `tests/benches/unwrap.rs` through the same declarations.

#![allow(unsafe_code, dead_code)] // each user has its own share

use std::ffi::{c_int, c_void};

// Links the C++ library; nothing of the crate's Rust side is used.
extern crate xatlas_rs as _;

#[repr(C)]
pub struct OutputChart {
    pub atlas_index: u32,
    pub indices: *mut u32,
    pub index_count: u32,
}

#[repr(C)]
pub struct OutputVertex {
    pub atlas_index: i32,
    pub uv: [f32; 2],
    pub xref: u32,
}

#[repr(C)]
pub struct OutputMesh {
    pub charts: *mut OutputChart,
    pub chart_count: u32,
    pub indices: *mut u32,
    pub index_count: u32,
    pub vertices: *mut OutputVertex,
    pub vertex_count: u32,
}

#[repr(C)]
pub struct OutputAtlas {
    pub width: u32,
    pub height: u32,
    pub atlas_count: u32,
    pub chart_count: u32,
    pub mesh_count: u32,
    pub meshes: *mut OutputMesh,
    pub utilization: *mut f32,
    pub texels_per_unit: f32,
}

#[repr(C)]
pub struct MeshDecl {
    pub vertex_count: u32,
    pub position_data: *const c_void,
    pub position_stride: u32,
    pub normal_data: *const c_void,
    pub normal_stride: u32,
    pub uv_data: *const c_void,
    pub uv_stride: u32,
    pub index_count: u32,
    pub index_data: *const c_void,
    pub index_offset: i32,
    pub index_format: c_int,
    pub face_ignore: *const bool,
}

pub const INDEX_U32: c_int = 1;
pub const ADD_MESH_SUCCESS: c_int = 0;

#[repr(C)]
#[derive(Clone, Copy)]
pub struct ChartOptions {
    pub max_chart_area: f32,
    pub max_boundary_length: f32,
    pub proxy_fit_metric_weight: f32,
    pub roundness_metric_weight: f32,
    pub straightness_metric_weight: f32,
    pub normal_seam_metric_weight: f32,
    pub texture_seam_metric_weight: f32,
    pub max_threshold: f32,
    pub grow_face_count: u32,
    pub max_iterations: u32,
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
pub struct PackOptions {
    pub attempts: c_int,
    pub texels_per_unit: f32,
    pub resolution: u32,
    pub max_chart_size: u32,
    pub block_align: bool,
    pub conservative: bool,
    pub padding: u32,
}

pub type ProgressFn = Option<unsafe extern "C" fn(c_int, c_int, *mut c_void)>;
pub type ParameterizeFn = Option<unsafe extern "C" fn(*const f32, *mut f32, u32, *const u32, u32, bool)>;
pub type PrintFn = Option<unsafe extern "C" fn(*const std::ffi::c_char, ...) -> c_int>;

unsafe extern "C" {
    #[link_name = "_ZN6xatlas6CreateEv"]
    pub fn create() -> *mut OutputAtlas;
    #[link_name = "_ZN6xatlas7DestroyEPNS_5AtlasE"]
    pub fn destroy(atlas: *mut OutputAtlas);
    #[link_name = "_ZN6xatlas7AddMeshEPNS_5AtlasERKNS_8MeshDeclE"]
    pub fn add_mesh(atlas: *mut OutputAtlas, declaration: *const MeshDecl) -> c_int;
    #[link_name = "_ZN6xatlas13ComputeChartsEPNS_5AtlasENS_12ChartOptionsEPFvNS_16ProgressCategory4EnumEiPvES5_"]
    pub fn compute_charts(atlas: *mut OutputAtlas, options: ChartOptions, progress: ProgressFn, user: *mut c_void);
    #[link_name = "_ZN6xatlas18ParameterizeChartsEPNS_5AtlasEPFvPKfPfjPKjjbEPFvNS_16ProgressCategory4EnumEiPvESB_"]
    pub fn parameterize_charts(
        atlas: *mut OutputAtlas,
        function: ParameterizeFn,
        progress: ProgressFn,
        user: *mut c_void,
    );
    #[link_name = "_ZN6xatlas10PackChartsEPNS_5AtlasENS_11PackOptionsEPFvNS_16ProgressCategory4EnumEiPvES5_"]
    pub fn pack_charts(atlas: *mut OutputAtlas, options: PackOptions, progress: ProgressFn, user: *mut c_void);
    #[link_name = "_ZN6xatlas8SetPrintEPFiPKczEb"]
    pub fn set_print(print: PrintFn, verbose: bool);
}
