//! What the layer's opinions depend on in the input stage: topology, instancing, names in use.

use crate::error::{Error, Result};
use crate::load::usd::{UsdSource, stage};
use crate::scene::Mesh;
use openusd::sdf::{FromValue, Value};
use openusd::usd::{Attribute, Prim, PrimPredicate, Stage, TimeCode};
use openusd_schemas::shade::MaterialBindingAPI;
use std::collections::{BTreeSet, HashMap, HashSet};

/// Prim types that shade: where a texture says which UVs it reads.
const SHADING: [&str; 3] = ["Material", "Shader", "NodeGraph"];

/// The composed input.
pub struct Input {
    pub stage: Stage,
    /// The moment that was baked; none: the default time.
    time: Option<TimeCode>,
    /// The scene's meshes whose faces are not their prim's own.
    remade: BTreeSet<usize>,
    place: String,
    /// Texts that shading nodes hold, and by them the primvars that they read.
    shading_texts: HashSet<String>,
    /// Materials that read displayColor.
    color_materials: HashSet<String>,
    instances: HashMap<String, bool>,
}

/// A mesh's face-varying corners.
pub struct Topology {
    /// The point of each corner: faceVertexIndices.
    pub corner_point: Vec<i32>,
    pub point_count: usize,
    /// The corners of each of our triangles.
    pub triangles: Vec<[u32; 3]>,
}

impl Input {
    /// Opens the stage of `source` as the loader did.
    ///
    /// # Errors
    /// `Invalid` where it can't be read.
    pub fn open(source: &UsdSource) -> Result<Self> {
        let mut input = Self {
            stage: stage::open(&source.path, &source.variants, &source.access)?,
            time: source.time.map(TimeCode::new),
            remade: source.remade.clone(),
            place: source.path.display().to_string(),
            shading_texts: HashSet::new(),
            color_materials: HashSet::new(),
            instances: HashMap::new(),
        };
        input.scan_shading().map_err(|e| Error::invalid(&input.place, e))?;
        Ok(input)
    }

    /// Visits every prim, which also makes the stage know all of its instances.
    fn scan_shading(&mut self) -> openusd::Result<()> {
        let mut paths = Vec::new();
        self.stage.traverse(PrimPredicate::DEFAULT_PROXIES, |p| paths.push(p.clone()))?;
        for path in paths {
            let prim = self.stage.prim(path.clone())?;
            let is_shading = prim.type_name()?.is_some_and(|t| SHADING.contains(&t.as_str()));
            if !is_shading {
                continue;
            }
            for attribute in prim.authored_attributes()? {
                let text = match attribute.get::<Value>()? {
                    Some(Value::String(s)) => s,
                    Some(Value::Token(t)) => t.as_str().to_string(),
                    _ => continue,
                };
                if text == "displayColor" {
                    let material = path.ancestors_below_root().find(|a| {
                        let prim = self.stage.prim(a.clone()).ok();
                        prim.and_then(|p| p.type_name().ok()?).is_some_and(|t| t.as_str() == "Material")
                    });
                    self.color_materials.extend(material.map(|m| m.as_str().to_string()));
                }
                self.shading_texts.insert(text);
            }
        }
        Ok(())
    }

    /// True where a shading node names the primvar `name`.
    pub fn is_read_by_shading(&self, name: &str) -> bool {
        self.shading_texts.contains(name)
    }

    /// The prim at `path`, where the stage has one that can hold opinions under that name.
    pub fn prim(&self, path: &str) -> Option<Prim> {
        let prim = self.stage.prim(path).ok().filter(|p| p.path().as_str() == path && p.path().is_prim_path())?;
        prim.is_valid().is_ok_and(|valid| valid).then_some(prim)
    }

    /// The native instances strictly above `path`, outermost first: nothing can be said below one but through what it
    /// inherits.
    pub fn instances_above(&mut self, path: &str) -> Vec<String> {
        let ends = path.match_indices('/').map(|(i, _)| i).filter(|&i| i > 0);
        let mut found = Vec::new();
        for ancestor in ends.map(|end| &path[..end]) {
            let is_instance = match self.instances.get(ancestor) {
                Some(&known) => known,
                None => {
                    let is_instance = self.prim(ancestor).is_some_and(|p| p.is_instance().unwrap_or(false));
                    self.instances.insert(ancestor.to_string(), is_instance);
                    is_instance
                }
            };
            if is_instance {
                found.push(ancestor.to_string());
            }
        }
        found
    }

    /// The prototype of the native instance at `path`.
    pub fn prototype(&self, path: &str) -> Option<String> {
        Some(self.prim(path)?.prototype().ok()??.as_str().to_string())
    }

    /// The instances of a prototype in the order of their paths; nested ones lie below another prototype. One in a class is
    /// an instance too, and needs the opinions of the others to share their prototype.
    pub fn instances(&self, prototype: &str) -> Vec<String> {
        let paths = self.stage.prim(prototype).ok().and_then(|p| p.instances().ok()).unwrap_or_default();
        paths.iter().map(|p| p.as_str().to_string()).collect::<BTreeSet<_>>().into_iter().collect()
    }

    /// Names of the prims at the root.
    pub fn root_names(&self) -> HashSet<String> {
        self.stage.root_prims().unwrap_or_default().iter().map(|n| n.as_str().to_string()).collect()
    }

    /// True where the faces of the scene's mesh `mesh` are not its prim's own.
    pub fn is_remade(&self, mesh: usize) -> bool {
        self.remade.contains(&mesh)
    }

    /// The corners of `prim`, of which the scene made its mesh number `index`, `mesh`; `None` where the prim is no mesh. A
    /// remade one has those of the Mesh that stands in for it: its triangles.
    pub fn topology(&self, prim: &Prim, index: usize, mesh: &Mesh) -> Option<Topology> {
        if self.is_remade(index) {
            let corner_point = mesh.triangles.iter().flatten().map(|&v| v as i32).collect();
            let triangles = (0..mesh.triangles.len() as u32).map(|t| [3 * t, 3 * t + 1, 3 * t + 2]).collect();
            return Some(Topology { corner_point, point_count: mesh.positions.len(), triangles });
        }
        let corner_point: Vec<i32> = self.value(&prim.attribute("faceVertexIndices"))?;
        let points: Vec<openusd::gf::Vec3f> = self.value(&prim.attribute("points")).unwrap_or_default();
        let triangles = mesh.origin.iter().map(|origin| origin.corners).collect();
        Some(Topology { corner_point, point_count: points.len(), triangles })
    }

    /// Instances of a point instancer, those that aren't shown included.
    pub fn point_count(&self, instancer: &Prim) -> usize {
        self.value::<Vec<i32>>(&instancer.attribute("protoIndices")).map_or(0, |indices| indices.len())
    }

    /// True where the look of `prim` depends on its displayColor: a material bound to it or a subset of it reads it, or no
    /// material is bound and it is the colour itself. A displayColor of an earlier bake of ours doesn't count.
    pub fn needs_display_color(&self, prim: &Prim) -> bool {
        let bound = self.bound_materials(prim);
        let subsets = prim.children().unwrap_or_default();
        let mut subsets = subsets.iter().filter(|c| c.type_name().ok().flatten().is_some_and(|t| t == "GeomSubset"));
        let is_read = |materials: &[String]| materials.iter().any(|m| self.color_materials.contains(m));
        if is_read(&bound) || subsets.any(|s| is_read(&self.bound_materials(s))) {
            return true;
        }
        bound.is_empty() && prim.path().ancestors_below_root().any(|p| self.has_own_color(p.as_str()))
    }

    fn has_own_color(&self, path: &str) -> bool {
        let Some(prim) = self.prim(path) else { return false };
        let color = prim.attribute("primvars:displayColor");
        let is_ours = matches!(
            color.get_metadata::<Value>("customData"),
            Ok(Some(Value::Dictionary(d))) if d.contains_key("lumel:baked")
        );
        !is_ours && color.has_authored_value().unwrap_or(false)
    }

    fn bound_materials(&self, prim: &Prim) -> Vec<String> {
        // Many files bind without applying the API, and an inherited binding needs none.
        let binding = MaterialBindingAPI::from_prim_unchecked(prim.clone());
        let purposes = ["", "preview", "full"].into_iter();
        let bound = purposes.filter_map(|p| binding.compute_bound_material(p).ok().flatten());
        bound.map(|p| p.as_str().to_string()).collect()
    }

    /// An attribute's value at the moment that was baked: without a time code the default, or the first of its samples.
    pub fn value<T: FromValue>(&self, attribute: &Attribute) -> Option<T>
    where
        T::Error: Into<openusd::Error>,
    {
        if self.time.is_some() {
            return attribute.get_at::<T>(self.time).ok().flatten();
        }
        let default = attribute.get::<T>().ok().flatten();
        default.or_else(|| attribute.get_at::<T>(TimeCode::EARLIEST).ok().flatten())
    }
}
