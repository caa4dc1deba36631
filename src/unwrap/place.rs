//! The layout as UVs of meshes and rectangles of surfaces.

use super::authored::Set;
use super::chart::{self, Chart};
use super::layout::{Content, Layout};
use super::pack::{self, Slot};
use super::{Atlas, MeshUvs, Placement, mask};
use crate::scene::Scene;
use glam::{DVec2, Vec2};

/// The layout as UVs and placements.
pub fn place(scene: &Scene, contents: Vec<Content>, sets: Vec<Option<Set>>, layout: Layout) -> Atlas {
    let mut meshes = vec![MeshUvs::default(); scene.meshes.len()];
    let mut placements = Vec::with_capacity(scene.surfaces.len());
    let vector = |size: [u32; 2]| DVec2::new(f64::from(size[0]), f64::from(size[1]));
    for (surface, (page, slots)) in scene.surfaces.iter().zip(&layout.surfaces) {
        let m = surface.mesh;
        let sized = &layout.sized[m];
        let page_size = vector(layout.pages[*page as usize]);
        let mut placement = Placement { page: *page, scale: Vec2::ONE, offset: Vec2::ZERO };
        // The rectangle of a shared mesh or of authored UVs.
        let mut rectangle = |low: DVec2, size: DVec2| {
            let scale = vector(sized.pieces[0].mask.size) / size;
            placement.scale = (scale / page_size).as_vec2();
            placement.offset = ((vector(slots[0].at) - low * scale) / page_size).as_vec2();
        };
        match &contents[m] {
            Content::Charts(charts) => meshes[m] = mesh_uvs(scene, m, charts, &sized.charts, slots, page_size),
            Content::Shared(charts) => {
                rectangle(DVec2::ZERO, DVec2::ONE);
                if let (true, Some(block)) = (meshes[m].corners.is_empty(), &sized.block) {
                    meshes[m] = mesh_uvs(scene, m, charts, &sized.charts, &block.slots, vector(block.size));
                }
            }
            Content::Authored { .. } => {
                if let Some(set) = &sets[m] {
                    rectangle(set.low, set.high - set.low);
                }
            }
            Content::Unused => {}
        }
        placements.push(placement);
    }
    for (mesh, set) in meshes.iter_mut().zip(sets) {
        if let Some(set) = set {
            *mesh = set.uvs;
        }
    }
    let Layout { pages, density, padding, shown_pages, .. } = layout;
    Atlas { pages, meshes, placements, density: density as f32, padding, shown_pages }
}

/// UVs of a mesh whose charts have boxes of `boxes` texels at `slots` of a rectangle of `size` texels.
fn mesh_uvs(scene: &Scene, mesh: usize, charts: &[Chart], boxes: &[[u32; 2]], slots: &[Slot], size: DVec2) -> MeshUvs {
    let count = scene.meshes[mesh].triangles.len();
    let mut uvs = MeshUvs {
        corners: vec![[Vec2::ZERO; 3]; count],
        chart: vec![0; count],
        chart_count: charts.len() as u32,
        authored: None,
    };
    for (number, ((chart, &texels), &slot)) in charts.iter().zip(boxes).zip(slots).enumerate() {
        for (&t, corners) in chart.triangles.iter().zip(pack::texels(chart, texels, slot)) {
            uvs.corners[t as usize] = rounded(corners, size);
            uvs.chart[t as usize] = number as u32;
        }
    }
    uvs
}

/// UVs in single precision of a triangle in texels, which still has area: a sliver that rounding would flatten is widened,
/// by less than [`mask::BORDER`].
fn rounded(corners: [DVec2; 3], size: DVec2) -> [Vec2; 3] {
    let round = |corners: [DVec2; 3]| corners.map(|p| (p / size).as_vec2());
    let has_area = |uv: [Vec2; 3]| chart::signed_area(uv.map(|p| p.as_dvec2())) > 0.0;
    let uv = round(corners);
    if has_area(uv) {
        return uv;
    }
    // The corner between the two others, and the way from them that gives area.
    let length = |k: usize| corners[(k + 1) % 3].distance_squared(corners[(k + 2) % 3]);
    let middle = (0..3).max_by(|&a, &b| length(a).total_cmp(&length(b))).unwrap_or(0);
    let along = corners[(middle + 2) % 3] - corners[(middle + 1) % 3];
    let aside = along.try_normalize().unwrap_or(DVec2::X).perp();
    for step in 1..8 {
        let by = aside * mask::BORDER * f64::from(step) / 8.0;
        let mut moved = corners;
        moved[middle] += by;
        let within = moved[middle].cmpge(DVec2::ZERO).all() && moved[middle].cmple(size).all();
        if !within {
            // Off the page: the others move the other way, so that the sliver stays between them.
            moved = corners.map(|p| p - by);
            moved[middle] = corners[middle];
        }
        let uv = round(moved);
        if has_area(uv) {
            return uv.map(|p| p.clamp(Vec2::ZERO, Vec2::ONE));
        }
    }
    uv
}
