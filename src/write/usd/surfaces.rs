//! Opinions on the lightmapped gprims, on the instances that hold them, and on point instancers.

use super::input::{Input, Topology};
use super::instances::{InstanceSurfaces, Instances};
use super::layer::{self, Attribute, Layer, array, quoted, tuple};
use super::metadata::page_path;
use super::{primvars, stand_in};
use crate::color::Rgb;
use crate::error::{Result, Warnings};
use crate::meshing::LitMesh;
use crate::scene::SurfaceOrigin;
use crate::write::Baked;
use glam::DVec3;
use openusd::usd::Prim;
use std::collections::{BTreeMap, HashMap};

/// The primvar that shows, and those that hold the light.
pub const DISPLAY_COLOR: &str = "displayColor";
const COLORS: [&str; 2] = ["lumel:irradiance", DISPLAY_COLOR];

/// Says why there are no baked colours.
const SHARED: &str = "lies below an instance, whose prims are shared, so it has no baked vertex colours in the layer";

/// What is being written.
struct Author<'a, 'b> {
    baked: &'a Baked<'a>,
    input: &'b mut Input,
    layer: &'b mut Layer,
    warnings: &'b mut Warnings,
    instances: Instances,
    /// The primvar that new UVs go to.
    uv_name: String,
    /// The mesh whose UVs a site holds.
    sites: HashMap<String, usize>,
}

/// An instancer's surfaces, (index of the instance, of the surface) by the path of the prototype's gprim.
type Points<'a> = BTreeMap<&'a str, Vec<(usize, usize)>>;

/// Says all there is to say about the surfaces; gives the classes that were made for instances.
///
/// # Errors
/// `Unsupported` where a page's name can't be written as an asset path.
pub fn author(baked: &Baked, input: &mut Input, layer: &mut Layer, warnings: &mut Warnings) -> Result<Instances> {
    let mut plain: Vec<(String, usize)> = Vec::new();
    let mut roots: BTreeMap<String, InstanceSurfaces> = BTreeMap::new();
    let mut instancers: BTreeMap<&str, Points> = BTreeMap::new();
    for (i, surface) in baked.scene.surfaces.iter().enumerate() {
        let path = match &surface.origin {
            SurfaceOrigin::UsdPrim => surface.name.clone(),
            SurfaceOrigin::UsdInstance { root, prim } => format!("{root}/{prim}").trim_end_matches('/').to_string(),
            SurfaceOrigin::UsdPoint { instancer, index, prim } => {
                instancers.entry(instancer).or_default().entry(prim).or_default().push((*index, i));
                continue;
            }
            SurfaceOrigin::None | SurfaceOrigin::GltfNode(_) => {
                warnings.add(&surface.name, "is no prim of the stage, so the layer says nothing about it");
                continue;
            }
        };
        match input.instances_above(&path).into_iter().next() {
            Some(root) => {
                let prim = path[root.len() + 1..].to_string();
                roots.entry(root).or_default().insert(prim, (i, surface.mesh));
            }
            None => plain.push((path, i)),
        }
    }
    let uv_name = free_uv_name(baked, input, warnings);
    let same = |a: usize, b: usize| {
        a == b
            || (baked.atlas.meshes[a] == baked.atlas.meshes[b]
                && baked.scene.meshes[a].origin == baked.scene.meshes[b].origin)
    };
    let instances = Instances::plan(&roots, input, layer, same);
    let mut author = Author { baked, input, layer, warnings, instances, uv_name, sites: HashMap::new() };
    for (path, surface) in plain {
        author.gprim(&path, surface)?;
    }
    for (root, surfaces) in &roots {
        author.instance(root, surfaces)?;
    }
    for (instancer, points) in &instancers {
        author.instancer(instancer, points)?;
    }
    Ok(author.instances)
}

/// The first of `st1`, `st2`, ... that no material reads.
fn free_uv_name(baked: &Baked, input: &Input, warnings: &mut Warnings) -> String {
    let slots = baked.scene.materials.iter().flat_map(crate::scene::Material::slots);
    let used: Vec<&str> = slots.map(|s| s.uv_set.as_str()).collect();
    let is_free = |name: &String| !used.contains(&name.as_str()) && !input.is_read_by_shading(name);
    let name = (1..).map(|i| format!("st{i}")).find(is_free).unwrap_or_else(|| "st1".into());
    if name != "st1" {
        warnings.add(&name, "materials read st1, so the layer's lightmap UVs have the next free name");
    }
    name
}

/// What sets the names of a gprim's rectangle and page apart where several stand on one prim: its path with `:` for `/`.
fn suffix(prim: &str) -> String {
    format!(":{}", prim.trim_start_matches('/').replace('/', ":"))
}

impl Author<'_, '_> {
    /// A gprim that takes opinions of its own.
    fn gprim(&mut self, path: &str, surface: usize) -> Result<()> {
        let mesh = self.baked.scene.surfaces[surface].mesh;
        if !self.baked.atlas.is_shown(surface) {
            self.colors_alone(path, surface);
            return Ok(());
        }
        if self.uvs(path, mesh) {
            let rectangle = self.rectangle(surface, "")?;
            let colors = self.colors(path, surface);
            let prim = self.layer.prim(path);
            rectangle.into_iter().chain(colors).for_each(|a| prim.set(a));
        }
        Ok(())
    }

    /// A gprim without lightmap: its baked colours, where it receives.
    fn colors_alone(&mut self, path: &str, surface: usize) {
        let placed = &self.baked.scene.surfaces[surface];
        if !placed.role.receives || self.baked.vertices.is_none() {
            return;
        }
        if self.input.is_remade(placed.mesh) {
            let message = "has faces of its own making and no lightmap, so it has no baked vertex colours in the layer";
            self.warnings.add(path, message);
            return;
        }
        let mut attributes = self.colors(path, surface);
        attributes.push(self.quantity());
        let prim = self.layer.prim(path);
        attributes.into_iter().for_each(|a| prim.set(a));
    }

    /// A native instance with the surfaces below it.
    fn instance(&mut self, root: &str, surfaces: &InstanceSurfaces) -> Result<()> {
        let several = self.instances.holds_several(root);
        for (prim, &(surface, mesh)) in surfaces {
            let path = format!("{root}/{prim}");
            if !self.baked.atlas.is_shown(surface) {
                if self.baked.scene.surfaces[surface].role.receives {
                    self.warnings.add(&path, SHARED);
                }
                continue;
            }
            if !self.uvs(&path, mesh) {
                continue;
            }
            self.warnings.add(&path, SHARED);
            let suffix = if several { suffix(prim) } else { String::new() };
            for attribute in self.rectangle(surface, &suffix)? {
                self.layer.prim(root).set(attribute);
            }
        }
        Ok(())
    }

    /// A point instancer with the surfaces of its prototypes.
    fn instancer(&mut self, instancer: &str, points: &Points) -> Result<()> {
        let Some(stage_prim) = self.input.prim(instancer) else {
            self.warnings.add(instancer, "is no prim of the stage, so the layer says nothing about it");
            return Ok(());
        };
        let mut placed: Points = BTreeMap::new();
        for (&prim, items) in points {
            let mut kept = Vec::with_capacity(items.len());
            for &(index, surface) in items.iter().filter(|(_, surface)| self.baked.atlas.is_shown(*surface)) {
                if self.uvs(prim, self.baked.scene.surfaces[surface].mesh) {
                    kept.push((index, surface));
                }
            }
            if !kept.is_empty() {
                self.warnings.add(prim, SHARED);
                placed.insert(prim, kept);
            }
        }
        if !self.input.instances_above(instancer).is_empty() {
            self.warnings.add(instancer, "is a point instancer below an instance; its rectangles can't be said in USD");
            return Ok(());
        }
        let mut indices: Vec<usize> = placed.values().flatten().map(|&(index, _)| index).collect();
        indices.sort_unstable();
        let shares_an_index = indices.windows(2).any(|pair| pair[0] == pair[1]);
        // The loader read the indices from the stage, so one beyond its instances is a mistake, and could be any size.
        let count = self.input.point_count(&stage_prim);
        if indices.last().is_some_and(|&last| last >= count) {
            self.warnings.add(instancer, "has fewer instances than were baked; its rectangles were left out");
            return Ok(());
        }
        let groups: Vec<(String, Vec<(usize, usize)>)> = if shares_an_index {
            placed.into_iter().map(|(prim, items)| (suffix(prim), items)).collect()
        } else {
            vec![(String::new(), placed.into_values().flatten().collect())]
        };
        let mut attributes = Vec::new();
        for (suffix, items) in groups {
            let (mut rectangles, mut pages) = (vec![[0.0; 4]; count], vec![-1i64; count]);
            for (index, surface) in items {
                let placement = &self.baked.atlas.placements[surface];
                rectangles[index] = primvars::scale_offset(placement);
                pages[index] = i64::from(placement.page);
            }
            let rectangles = array(&rectangles, |text, r| tuple(text, r));
            let pages = array(&pages, |text, p| text.push_str(&p.to_string()));
            let name = |base: &str| format!("lumel:{base}{suffix}");
            attributes.push(Attribute::primvar("float4[]", &name("scaleOffset"), "vertex", rectangles));
            attributes.push(Attribute::primvar("int[]", &name("page"), "vertex", pages));
        }
        let pages: Vec<String> =
            self.baked.page_uris.iter().map(|u| layer::asset(&page_path(u))).collect::<Result<_>>()?;
        attributes.push(Attribute::custom("asset[]", "lumel:lightmaps", format!("[{}]", pages.join(", "))));
        attributes.push(self.quantity());
        let prim = self.layer.prim(instancer);
        attributes.into_iter().for_each(|a| prim.set(a));
        Ok(())
    }

    /// Says the UVs of `mesh` for the gprim at `path` where all prims that share them can read them; false where it can't
    /// be done, with a warning.
    fn uvs(&mut self, path: &str, mesh: usize) -> bool {
        let Some(prim) = self.input.prim(path) else {
            self.warnings.add(path, "is no prim of the stage, so the layer says nothing about it");
            return false;
        };
        let site = self.instances.site(path, self.input, self.layer);
        let uvs = &self.baked.atlas.meshes[mesh];
        let scene_mesh = &self.baked.scene.meshes[mesh];
        if let Some(&known) = self.sites.get(&site) {
            let same = known == mesh
                || (self.baked.atlas.meshes[known] == *uvs
                    && self.baked.scene.meshes[known].origin == scene_mesh.origin);
            if !same {
                self.warnings
                    .add(path, "shares its primvars with a prim of other lightmap UVs; it has none in the layer");
            }
            return same;
        }
        let Some(topology) = self.input.topology(&prim, mesh, scene_mesh) else {
            self.warnings.add(path, "is no mesh, and only meshes can hold lightmap UVs; it has none in the layer");
            return false;
        };
        let is_remade = self.input.is_remade(mesh);
        let is_authored = |name: &str| prim.attribute(format!("primvars:{name}")).has_authored_value().unwrap_or(false);
        let authored = uvs.authored.as_deref().filter(|name| is_remade || is_authored(name));
        let new = match authored {
            Some(_) => Vec::new(),
            None => match primvars::uvs(&self.uv_name, uvs, &topology) {
                Some(attributes) => attributes.into(),
                None => {
                    self.warnings
                        .add(path, "was baked from another topology than the stage's; it has no UVs in the layer");
                    return false;
                }
            },
        };
        let name = quoted(authored.unwrap_or(&self.uv_name));
        let quantity = self.quantity();
        if is_remade {
            stand_in::author(&prim, scene_mesh, &site, self.input, self.layer, self.warnings);
        }
        let prim = self.layer.prim(&site);
        new.into_iter().for_each(|a| prim.set(a));
        prim.set(Attribute::custom("token", "lumel:uvName", name));
        prim.set(quantity);
        self.sites.insert(site, mesh);
        true
    }

    /// Rectangle, page and quantity of a surface.
    fn rectangle(&self, surface: usize, suffix: &str) -> Result<Vec<Attribute>> {
        let placement = &self.baked.atlas.placements[surface];
        let mut value = String::new();
        tuple(&mut value, &primvars::scale_offset(placement));
        let mut attributes =
            vec![Attribute::primvar("float4", &format!("lumel:scaleOffset{suffix}"), "constant", value)];
        if let Some(uri) = self.baked.page_uris.get(placement.page as usize) {
            let page = layer::asset(&page_path(uri))?;
            attributes.push(Attribute::custom("asset", format!("lumel:lightmap{suffix}"), page));
        }
        attributes.push(self.quantity());
        Ok(attributes)
    }

    fn quantity(&self) -> Attribute {
        Attribute::custom("token", "lumel:quantity", quoted(self.baked.quantity.name()))
    }

    /// The baked colours of a gprim that no other shares.
    fn colors(&mut self, path: &str, surface: usize) -> Vec<Attribute> {
        let index = self.baked.scene.surfaces[surface].mesh;
        let mesh = &self.baked.scene.meshes[index];
        let Some(lit) = self.baked.vertices.and_then(|c| c.surfaces.get(surface)) else { return Vec::new() };
        let Some(prim) = self.input.prim(path) else { return Vec::new() };
        let Some(topology) = self.input.topology(&prim, index, mesh) else { return Vec::new() };
        let Some(colors) = at_vertices(lit, mesh.triangles.len()) else { return Vec::new() };
        let shows_own = self.input.needs_display_color(&prim);
        if shows_own {
            self.warnings.add(path, "has a look that depends on displayColor, which was left as it is");
        }
        colors_at_corners(&prim, &colors, &topology, shows_own)
    }
}

/// The light `colors` (three a triangle) as primvars of `prim`; `shows_own`: without displayColor.
pub fn colors_at_corners(prim: &Prim, colors: &[[Rgb; 3]], topology: &Topology, shows_own: bool) -> Vec<Attribute> {
    let mut attributes = Vec::new();
    for name in COLORS.into_iter().filter(|name| !shows_own || *name != DISPLAY_COLOR) {
        let indices = prim.attribute(format!("primvars:{name}:indices"));
        let was_indexed = indices.has_authored_value().unwrap_or(false);
        let mut new = primvars::colors(name, colors, topology, was_indexed).unwrap_or_default();
        if let Some(first) = new.first_mut() {
            first.baked = name == DISPLAY_COLOR;
        }
        attributes.append(&mut new);
    }
    attributes
}

/// The light at the corners of the `count` triangles of a mesh as it was given, whatever they were cut into: the mean over the
/// pieces that have the corner. `None` where none has one.
fn at_vertices(lit: &LitMesh, count: usize) -> Option<Vec<[Rgb; 3]>> {
    if lit.is_given() {
        return Some(lit.triangles.iter().map(|t| t.values).collect());
    }
    // In f64 the mean of equal values is that value.
    let mut sums = vec![[(DVec3::ZERO, 0u32); 3]; count];
    for piece in &lit.triangles {
        for (place, value) in piece.corners.iter().zip(piece.values) {
            if let Some(corner) = place.corner() {
                let (sum, pieces) = &mut sums[piece.source as usize][corner];
                *sum += value.as_dvec3();
                *pieces += 1;
            }
        }
    }
    let is_whole = sums.iter().flatten().all(|(_, pieces)| *pieces > 0);
    is_whole.then(|| sums.iter().map(|t| t.map(|(sum, pieces)| (sum / f64::from(pieces)).as_vec3())).collect())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::meshing::{LitTriangle, Weights};

    #[test]
    fn a_given_vertex_has_the_light_that_it_has_in_the_pieces() {
        let [a, b, c] = Weights::CORNERS;
        let middle = Weights(DVec3::splat(1.0 / 3.0));
        let values = [Rgb::splat(0.1), Rgb::splat(0.7), Rgb::splat(5.3)];
        let piece = |corners, k: [usize; 2]| LitTriangle {
            source: 0,
            corners,
            values: [values[k[0]], values[k[1]], Rgb::ZERO],
        };
        let mut lit = LitMesh {
            triangles: vec![
                piece([a, b, middle], [0, 1]),
                piece([b, c, middle], [1, 2]),
                piece([c, a, middle], [2, 0]),
            ],
        };
        assert_eq!(at_vertices(&lit, 1), Some(vec![values]));
        lit.triangles[0].values[0] = Rgb::splat(0.3);
        assert_eq!(at_vertices(&lit, 1).unwrap()[0][0], Rgb::splat(0.2));
        lit.triangles.truncate(1);
        assert_eq!(at_vertices(&lit, 1), None);
    }
}
