//! Opinions on prims below native instances.
//!
//! USD takes no opinion from below an instance: it would no longer be one. What all instances of a prototype share (their
//! lightmap UVs) is said on a class prim, which each of them inherits; equal arcs leave them one prototype. What
//! differs (the rectangle on a page) is said on each instance's own prim as an inherited primvar.

use super::input::Input;
use super::layer::Layer;
use std::collections::{BTreeMap, HashMap, HashSet};

/// Where the stage's prims of a prototype begin; the names are not stable and never written.
const PROTOTYPE: &str = "/__Prototype_";

/// The class prims of the layer, and which instance inherits which.
#[derive(Default)]
pub struct Instances {
    classes: Vec<Class>,
    /// Class by the path of an outermost instance with surfaces.
    of_root: HashMap<String, usize>,
}

struct Class {
    /// Name of the class prim at the root.
    name: String,
    prototype: String,
    /// Mesh (index into the scene's) by the gprim's path relative to the instance.
    meshes: BTreeMap<String, usize>,
}

/// The surfaces of one outermost instance: index of the surface, and of its mesh, by the gprim's path relative to it.
pub type InstanceSurfaces = BTreeMap<String, (usize, usize)>;

impl Instances {
    /// Gives each of `roots`, by the paths of outermost instances, a class and lets all instances of their prototypes
    /// inherit one. Instances of one prototype share a class as long as `same` says that their meshes' UVs are the same;
    /// they don't where, say, bindings from above the instances give them different materials.
    pub fn plan(
        roots: &BTreeMap<String, InstanceSurfaces>,
        input: &mut Input,
        layer: &mut Layer,
        same: impl Fn(usize, usize) -> bool,
    ) -> Self {
        let mut taken = input.root_names();
        let mut plan = Self::default();
        for (root, surfaces) in roots {
            let Some(prototype) = input.prototype(root) else { continue };
            let agrees = |class: &Class| {
                let mut known = surfaces.iter().filter_map(|(prim, &(_, mesh))| Some((*class.meshes.get(prim)?, mesh)));
                class.prototype == prototype && known.all(|(a, b)| same(a, b))
            };
            let class = match plan.classes.iter().position(agrees) {
                Some(class) => class,
                None => plan.push(root, prototype, &mut taken),
            };
            let meshes = surfaces.iter().map(|(prim, &(_, mesh))| (prim.clone(), mesh));
            for (prim, mesh) in meshes {
                plan.classes[class].meshes.entry(prim).or_insert(mesh);
            }
            plan.of_root.insert(root.clone(), class);
        }
        for class in 0..plan.classes.len() {
            if plan.first_of(&plan.classes[class].prototype) == Some(class) {
                plan.connect(class, input, layer);
            }
        }
        plan
    }

    /// Where to say what holds for the prim at `path`: there, or in the class that the instance above it inherits.
    pub fn site(&mut self, path: &str, input: &mut Input, layer: &mut Layer) -> String {
        let above = input.instances_above(path);
        let mut site = path.to_string();
        for (i, instance) in above.iter().enumerate() {
            let planned = if i == 0 { self.of_root.get(instance).copied() } else { None };
            let class = match (planned, input.prototype(instance)) {
                (Some(class), _) => class,
                (None, Some(prototype)) => match self.first_of(&prototype) {
                    Some(class) => class,
                    None => self.add(instance, prototype, input, layer),
                },
                (None, None) => continue,
            };
            site = format!("/{}{}", self.classes[class].name, &path[instance.len()..]);
        }
        site
    }

    /// True where the instances that share the class of the one at `root` hold several gprims, so that each has to have a
    /// rectangle by a name of its own.
    pub fn holds_several(&self, root: &str) -> bool {
        self.of_root.get(root).is_some_and(|&class| self.classes[class].meshes.len() > 1)
    }

    fn first_of(&self, prototype: &str) -> Option<usize> {
        self.classes.iter().position(|c| c.prototype == prototype)
    }

    fn add(&mut self, instance: &str, prototype: String, input: &mut Input, layer: &mut Layer) -> usize {
        let mut taken = input.root_names();
        taken.extend(self.classes.iter().map(|c| c.name.clone()));
        let class = self.push(instance, prototype, &mut taken);
        self.connect(class, input, layer);
        class
    }

    fn push(&mut self, instance: &str, prototype: String, taken: &mut HashSet<String>) -> usize {
        let base = format!("_lumel_{}", instance.rsplit('/').next().unwrap_or_default());
        let mut names = std::iter::once(base.clone()).chain((2..).map(|i| format!("{base}_{i}")));
        let name = names.find(|n| !taken.contains(n)).unwrap_or(base);
        taken.insert(name.clone());
        self.classes.push(Class { name, prototype, meshes: BTreeMap::new() });
        self.classes.len() - 1
    }

    /// Lets every instance of the prototype of `class` inherit its class: one without surfaces too, or it would no longer
    /// share the prototype.
    fn connect(&mut self, class: usize, input: &mut Input, layer: &mut Layer) {
        for c in self.classes.iter().filter(|c| c.prototype == self.classes[class].prototype) {
            layer.prim(&format!("/{}", c.name)).is_class = true;
        }
        for instance in input.instances(&self.classes[class].prototype) {
            let of_instance = self.of_root.get(&instance).copied().unwrap_or(class);
            let inherited = format!("/{}", self.classes[of_instance].name);
            let Some(rest) = instance.strip_prefix(PROTOTYPE) else {
                layer.prim(&instance).inherit(&inherited);
                continue;
            };
            // Nested: the arc is said in the class of the instance around it.
            let (number, inner) = rest.split_once('/').unwrap_or((rest, ""));
            let outer = format!("{PROTOTYPE}{number}");
            if self.first_of(&outer).is_none()
                && let Some(around) = input.instances(&outer).first().cloned()
            {
                self.add(&around, outer.clone(), input, layer);
            }
            for c in self.classes.iter().filter(|c| c.prototype == outer) {
                layer.prim(&format!("/{}/{inner}", c.name)).inherit(&inherited);
            }
        }
    }
}
