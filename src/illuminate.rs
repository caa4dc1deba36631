//! The light of a scene in memory: rasterize, direct, exchange, post, in order; or with solve and gather in place of exchange; or
//! rasterize, trace, post.

mod caustics;
pub mod kept;
pub mod only;
pub mod state;

use crate::Result;
use crate::blocks::separate::{Source, Wanted};
use crate::blocks::{BlockParams, Exchanged, exchange, shown_normals};
use crate::color::Rgb;
use crate::energy::{self, EnergyBalance, balance};
use crate::error::Error;
use crate::gather::{Backs, Gathered, Sources, gather, read_elements};
use crate::integrate::World;
use crate::light::direct::DirectParams;
use crate::light::parts::{Apart, Part, direct_apart, parts};
use crate::light::{Direct, Lights, Lit, Shining, incident};
use crate::measure::measure;
use crate::medium::Media;
use crate::moments::Moments;
use crate::patch::unocclude::Exposure;
use crate::patch::{
    Emission, Ground, Patches, Reflectance, Sparse, rasterize, reflectance::reflectance, reflectance::shown_reflectance,
};
use crate::post::denoise::{Denoise, DenoiseReport, denoise, scales::Scales};
use crate::post::dilate::{Finish, finish};
use crate::post::directional::directional;
use crate::post::layers::{self, Group, layers};
use crate::post::seam::SeamReport;
use crate::post::{Directional, LayerKind, Lightmap};
use crate::probe::{LightProbes, Surroundings, probes};
use crate::progress::Progress;
use crate::reference::{trace, trace_backs};
use crate::scatter::{Scattering, Surfaces};
use crate::scene::{BakeMode, Scene, Surface};
use crate::sensor::Texels;
use crate::settings::{Gather, Method, Normals, Settings};
use crate::solve::{Solution, Solver, Watch, full_matrix, solve};
use crate::trace::{Tracer, Triangles};
use crate::transport::{Elements, Probes};
use crate::unwrap::Atlas;
use crate::work::Work;
use crate::write::{dump::Dump, watch::WatchFolder};
use caustics::Brought;
use kept::{Lamps, Look, Sight};
use only::Earlier;
use std::sync::Arc;

/// A scene with its light, and all that led to it.
pub struct Illuminated {
    pub patches: Patches,
    pub reflectance: Reflectance,
    pub emission: Emission,
    pub exposure: Exposure,
    pub direct: Direct,
    /// Empty where light was exchanged between blocks.
    pub elements: Elements,
    pub solution: Solution,
    pub gathered: Gathered,
    /// How it was exchanged between blocks, where it was.
    pub exchanged: Option<Exchanged>,
    /// How noise was taken out, where it was.
    pub denoised: Option<DenoiseReport>,
    /// How far light jumps across seams.
    pub seams: SeamReport,
    pub lightmap: Lightmap,
    /// Empty where materials send on light in ways that texels don't hold.
    pub energy: EnergyBalance,
    /// Rays that layers took besides.
    pub layer_rays: u64,
    pub probes: LightProbes,
}

impl Illuminated {
    /// What files show of it; the rest is let go.
    pub fn into_shown(self) -> (Patches, Exposure, Lightmap, LightProbes) {
        (self.patches, self.exposure, self.lightmap, self.probes)
    }
}

/// Finds the light of a scene in memory on the pages of `atlas`: everything between unwrapping and writing.
///
/// # Errors
/// `Cancelled`; `Invalid` where no texel is covered, there are too many elements for the solver, or the method can't leave direct
/// light out; `Io` where stages can't be dumped.
pub fn illuminate(scene: &Scene, atlas: &Atlas, settings: &Settings, progress: &dyn Progress) -> Result<Illuminated> {
    illuminate_with(scene, atlas, settings, &Work::unstored(), progress)
}

/// The same, with what `work` remembers.
///
/// # Errors
/// As [`illuminate`], and `Io` where what is remembered can't be read.
pub fn illuminate_with(
    scene: &Scene,
    atlas: &Atlas,
    settings: &Settings,
    work: &Work,
    progress: &dyn Progress,
) -> Result<Illuminated> {
    let stage = Stage::new(scene, atlas, settings, work, progress)?;
    light(scene, atlas, stage, settings, None, work, progress)
}

/// The same by radiosity between blocks for those surfaces alone whose light isn't known by an `earlier` bake. The energy of the rest being
/// out of sight, no balance is told. Errors are those of what is baked, relative to the mean light of all.
///
/// # Errors
/// As [`illuminate_with`]; `Invalid` where no texel is left to be baked, or a layer that is wanted isn't among those of the earlier bake.
pub fn illuminate_only(
    scene: &Scene,
    atlas: &Atlas,
    settings: &Settings,
    earlier: &Earlier,
    work: &Work,
    progress: &dyn Progress,
) -> Result<Illuminated> {
    let stage = Stage::new(scene, atlas, settings, work, progress)?;
    // Direct light of some texels, and what these see in light that pages show, are of no use to any other bake.
    light(scene, atlas, stage, settings, Some(earlier), &Work::unstored(), progress)
}

/// The light of what `stage` holds.
fn light(
    scene: &Scene,
    atlas: &Atlas,
    stage: Stage,
    settings: &Settings,
    earlier: Option<&Earlier>,
    work: &Work,
    progress: &dyn Progress,
) -> Result<Illuminated> {
    let dump = Dump::new(settings.dump_stages.as_deref());
    let ground = stage.ground(scene, atlas);
    let Stage { tracer: _, patches, reflectance, emission, exposure, lights, params } = &stage;
    dump.patches("normal", &ground, |i| patches.normal[i])?;
    dump.patches("albedo", &ground, |i| reflectance.0[i])?;
    dump.patches("emission", &ground, |i| emission.0[i])?;
    dump.patches("exposure", &ground, |i| exposure.share(i))?;
    let known = earlier.map(|earlier| &earlier.known[..]);
    let lit = Lit { ground: &ground, exposure, reflectance, emission, lights, params, known };
    if known.is_some() && !(0..patches.len()).any(|i| lit.is_wanted(i)) {
        return Err(Error::invalid("only", "none of the texels of what is selected lies in the open; select more"));
    }
    let Found { direct, elements, solution, mut gathered, backs, exchanged, mut groups, left_out, caustics } =
        find(&lit, settings, earlier, &dump, work, progress)?;

    let noisy = if groups.is_empty() { Vec::new() } else { gathered.irradiance.clone() };
    let denoised = denoise(&lit, &mut gathered, &settings.denoise_params(), progress)?;
    layers::follow(&mut groups, &noisy, &gathered.irradiance);
    if denoised.is_some() {
        dump.patches("denoised", &ground, |i| gathered.indirect[i])?;
    }
    if exchanged.is_some() && settings.layers.is_empty() {
        (gathered.indirect, gathered.difference) = (Vec::new(), Vec::new());
    }
    // Lights that the engine adds are not among those that are seen, but what surfaces send back of them is.
    let left_out = left_out.as_deref();
    let is_baked = |shining: Shining| shining.contribution(scene).mode() == BakeMode::Baked;
    let seen_lights = left_out.map(|_| Lights::of(scene, is_baked));
    let seen = Lit { lights: seen_lights.as_ref().unwrap_or(lights), ..lit };
    let probes = match &settings.probes {
        None => LightProbes::default(),
        Some(_) => {
            let with = |(i, e): (usize, &Rgb)| left_out.map_or(*e, |left_out| *e + left_out[i]);
            let irradiance: Vec<Rgb> = gathered.irradiance.iter().enumerate().map(with).collect();
            let around = Surroundings { lit: &seen, irradiance: &irradiance, backs: &backs };
            probes(&around, &settings.probe_params(scene)?, progress)?
        }
    };
    progress.begin("post", 0);
    // What doesn't cast is black as a source, but has its own look on the pages.
    let looks = match scene.surfaces.iter().all(|s| s.role.casts) {
        true => None,
        false => Some(shown_reflectance(&ground, progress)?),
    };
    let shown = match &looks {
        Some((reflectance, emission)) => Lit { reflectance, emission, ..lit },
        None => lit,
    };
    let to = Finish::new(shown, settings.seams, settings.gutter, settings.quantity);
    let (mut lightmap, seams) = finish(&to, &gathered.irradiance, settings.quantity);
    let sources =
        layers::Sources { to: &to, direct: &direct, gathered: &gathered, groups: &groups, caustics: &caustics.shown };
    let layer_rays;
    (lightmap.layers, layer_rays) = layers(&sources, &settings.layer_params(), progress)?;
    if settings.directional != Directional::Off {
        let moments = all_moments(&seen, &direct, &gathered, settings, progress)?;
        let normals = shown_normals(&lit);
        let normal = |i: usize| normals.as_ref().map_or(patches.normal[i], |n| n[i]);
        let form = (settings.directional, settings.quantity);
        // About what pages show, seams closed: a flat normal map is to change nothing.
        let seen = lightmap.irradiance(patches);
        lightmap.layers.extend(directional(&to.without_seams(), &seen, &moments, &normal, form));
    }
    if let Some(earlier) = earlier {
        earlier.put_back(&to.without_seams(), &mut lightmap)?;
    }
    let bake =
        energy::Bake { lit, direct: &direct, backs: &backs, gathered: &gathered, left_out, taken: &caustics.taken };
    let energy = match needs_walks(scene, settings) || earlier.is_some() {
        true => EnergyBalance::default(),
        false => balance(&bake, &lightmap, !settings.float),
    };
    let Stage { patches, reflectance, emission, exposure, .. } = stage;
    Ok(Illuminated {
        patches,
        reflectance,
        emission,
        exposure,
        direct,
        elements,
        solution,
        gathered,
        exchanged,
        denoised,
        seams,
        lightmap,
        energy,
        layer_rays,
        probes,
    })
}

/// Does the part of the work on the light of a scene that is this process's, of several that share it; all is done by one of them when
/// this returns, but for what comes after what blocks see.
///
/// # Errors
/// As [`illuminate_with`]; `Awaited` where other machines have parts of it.
pub fn share(scene: &Scene, atlas: &Atlas, settings: &Settings, work: &Work, progress: &dyn Progress) -> Result<()> {
    let stage = Stage::new(scene, atlas, settings, work, progress)?;
    let ground = stage.ground(scene, atlas);
    let Stage { tracer: _, patches: _, reflectance, emission, exposure, lights, params } = &stage;
    let lit = Lit { ground: &ground, exposure, reflectance, emission, lights, params, known: None };
    let parts = parts(scene, settings.layers.contains(&LayerKind::LightGroups));
    let mut apart = direct_apart(&lit, &parts, false, &Lamps { lit: &lit, work, progress }, progress)?;
    caustics::add(&lit, &parts, &mut apart, settings, progress)?;
    kept::see(&lit, &apart.whole, &settings.block_params(), &parts, Look::Once, work, progress)?;
    Ok(())
}

/// The texels of a scene, and what of them lies in the open: all that pages of known light are read by.
///
/// # Errors
/// As [`illuminate_with`].
pub fn texels(
    scene: &Scene,
    atlas: &Atlas,
    settings: &Settings,
    work: &Work,
    progress: &dyn Progress,
) -> Result<(Patches, Exposure)> {
    let Stage { patches, exposure, .. } = Stage::new(scene, atlas, settings, work, progress)?;
    Ok((patches, exposure))
}

/// What light falls on.
struct Stage {
    tracer: Tracer,
    patches: Patches,
    reflectance: Reflectance,
    emission: Emission,
    exposure: Exposure,
    lights: Lights,
    params: DirectParams,
}

impl Stage {
    fn new(scene: &Scene, atlas: &Atlas, settings: &Settings, work: &Work, progress: &dyn Progress) -> Result<Self> {
        // The tree is built by one thread.
        let triangles = Triangles::new(scene);
        let (tracer, patches) =
            rayon::join(|| Tracer::with(scene, triangles.clone()), || rasterize(scene, atlas, &triangles, progress));
        let patches = patches?;
        let ground = Ground { scene, atlas, tracer: &tracer, patches: &patches };
        let (reflectance, emission) = reflectance(&ground, progress)?;
        let exposure = kept::expose(&ground, settings.seed, work, progress)?;
        let (lights, params) = (Lights::new(scene), settings.direct_params());
        Ok(Self { tracer, patches, reflectance, emission, exposure, lights, params })
    }

    fn ground<'a>(&'a self, scene: &'a Scene, atlas: &'a Atlas) -> Ground<'a> {
        Ground { scene, atlas, tracer: &self.tracer, patches: &self.patches }
    }
}

/// Where all light of each patch comes from.
fn all_moments(
    lit: &Lit,
    direct: &Direct,
    gathered: &Gathered,
    settings: &Settings,
    progress: &dyn Progress,
) -> Result<Vec<Moments>> {
    if settings.method == Method::Path {
        // Paths know where direct light comes from as well.
        return Ok(gathered.moments.clone());
    }
    let mut moments = incident(lit, direct, progress)?;
    moments.iter_mut().zip(&gathered.moments).for_each(|(sum, gathered)| *sum += *gathered);
    Ok(moments)
}

/// The light of all texels, and how it was found.
struct Found {
    direct: Direct,
    elements: Elements,
    solution: Solution,
    gathered: Gathered,
    backs: Backs,
    exchanged: Option<Exchanged>,
    /// Light groups, where they were asked for.
    groups: Vec<Group>,
    /// What arrives and is not to be shown [lx].
    left_out: Option<Vec<Rgb>>,
    /// What came over mirrors and glass as if straight from lights.
    caustics: Brought,
}

/// The light of all texels, by the method that is asked for.
fn find(
    lit: &Lit,
    settings: &Settings,
    earlier: Option<&Earlier>,
    dump: &Dump,
    work: &Work,
    progress: &dyn Progress,
) -> Result<Found> {
    let elements = || Elements::new(lit.ground, lit.exposure, lit.reflectance, settings.element_count(), settings.seed);
    let parts = parts(lit.ground.scene, settings.layers.contains(&LayerKind::LightGroups));
    let mut found = match (settings.method, settings.gather()) {
        (Method::Path, _) if !needs_walks(lit.ground.scene, settings) => {
            paths(lit, &parts, elements(), settings, dump, progress)?
        }
        (Method::Path | Method::Ray | Method::Bidirectional | Method::Metropolis | Method::Photon, _) => {
            by_walks(lit, &parts, settings, dump, progress)?
        }
        (Method::Radiosity, Gather::Blocks) => by_blocks(lit, &parts, settings, earlier, dump, work, progress)?,
        (Method::Radiosity, _) => by_elements(lit, &parts, elements(), settings, dump, work, progress)?,
    };
    if leaves_out_sky(&parts) {
        found.leave_out_sky();
    }
    Ok(found)
}

/// True where indirect light alone is wanted of the sky.
fn leaves_out_sky(parts: &[Part]) -> bool {
    parts.iter().any(|part| part.mode == BakeMode::Indirect && part.lights.sky.is_some())
}

impl Found {
    /// Takes the light that comes straight from the sky off what is shown.
    fn leave_out_sky(&mut self) {
        let Gathered { irradiance, indirect, sky, .. } = &mut self.gathered;
        let left_out = self.left_out.get_or_insert_with(|| vec![Rgb::ZERO; irradiance.len()]);
        for (i, sky) in sky.iter_mut().enumerate() {
            let sky = std::mem::take(sky);
            irradiance[i] = (irradiance[i] - sky).max(Rgb::ZERO);
            indirect[i] -= sky;
            left_out[i] += sky;
        }
    }
}

/// The light by radiosity between blocks of texels.
fn by_blocks(
    lit: &Lit,
    parts: &[Part],
    settings: &Settings,
    earlier: Option<&Earlier>,
    dump: &Dump,
    work: &Work,
    progress: &dyn Progress,
) -> Result<Found> {
    let keep = settings.layers.contains(&LayerKind::LightGroups);
    let mut apart = direct_apart(lit, parts, keep, &Lamps { lit, work, progress }, progress)?;
    let caustics = caustics::add(lit, parts, &mut apart, settings, progress)?;
    if let Some(earlier) = earlier {
        earlier.send(lit, parts, &mut apart)?;
    }
    let Apart { whole: direct, left_out, each } = apart;
    dump.patches("direct", lit.ground, |i| direct.shown[i])?;
    let sources: Vec<Source> = parts.iter().zip(&each).map(|(part, direct)| source(part, direct)).collect();
    let wanted = Wanted { sources: &sources, bounces: settings.bounce_layers() };
    let params = settings.block_params();
    let params = BlockParams { layers: params.layers || leaves_out_sky(parts), ..params };
    let how = if settings.relight.is_some() { Look::Never } else { Look::Once };
    let Sight { seen, is_fresh } = kept::see(lit, &direct, &params, parts, how, work, progress)?;
    let mut found = exchange(lit, &direct, &params, wanted, seen, work, progress)?;
    // What was looked at in other light may be seen too coarsely in this one.
    if !is_fresh && how == Look::Once && found.2.is_rough(params.error) {
        let Sight { seen, .. } = kept::see(lit, &direct, &params, parts, Look::Anew, work, progress)?;
        found = exchange(lit, &direct, &params, wanted, seen, work, progress)?;
    }
    let (mut gathered, backs, exchanged) = found;
    dump.patches("indirect", lit.ground, |i| gathered.irradiance[i] - direct.shown[i])?;
    let groups = light_groups(parts, &each, std::mem::take(&mut gathered.groups));
    let (elements, solution) = (Elements::default(), Solution::default());
    Ok(Found { direct, elements, solution, gathered, backs, exchanged: Some(exchanged), groups, left_out, caustics })
}

fn source<'a>(part: &'a Part, direct: &'a Direct) -> Source<'a> {
    Source { lights: &part.lights, direct, shows_sky: part.mode == BakeMode::Baked }
}

/// The light of each group: what its parts show of their direct light, `each`, and what they cause between surfaces.
fn light_groups(parts: &[Part], each: &[Direct], between: Vec<Vec<Rgb>>) -> Vec<Group> {
    let mut groups: Vec<Group> = Vec::new();
    for ((part, direct), mut irradiance) in parts.iter().zip(each).zip(between) {
        if part.mode == BakeMode::Baked {
            irradiance.iter_mut().zip(direct.shown.iter()).for_each(|(sum, direct)| *sum += *direct);
        }
        match groups.last_mut().filter(|group| group.name == part.group()) {
            Some(group) => group.irradiance.iter_mut().zip(irradiance).for_each(|(sum, more)| *sum += more),
            None => groups.push(Group { name: part.group().to_owned(), irradiance }),
        }
    }
    groups
}

/// The light by radiosity between elements, and a gather.
fn by_elements(
    lit: &Lit,
    parts: &[Part],
    elements: Elements,
    settings: &Settings,
    dump: &Dump,
    work: &Work,
    progress: &dyn Progress,
) -> Result<Found> {
    if settings.solver == Solver::FullMatrix {
        // Backs come on top of what the settings say.
        full_matrix::refuse_too_many(elements.len())?;
    }
    let mut apart = direct_apart(lit, parts, false, &Lamps { lit, work, progress }, progress)?;
    let caustics = caustics::add(lit, parts, &mut apart, settings, progress)?;
    let Apart { whole: direct, left_out, .. } = apart;
    dump.patches("direct", lit.ground, |i| direct.shown[i])?;

    let params = settings.solve_params(elements.len());
    let probes = Probes::new(&elements, *lit, params.transport.probe_rays);
    let pages = settings.watch.as_deref().map(|folder| WatchFolder::new(folder, lit, &direct, settings.quantity));
    let mut show = |iteration: u64, received: &[Rgb]| match &pages {
        Some(pages) => pages.show(iteration, lit, |i| direct.shown[i] + elements.read(received, i)),
        None => Ok(()),
    };
    let watch = settings.watch.is_some().then_some(Watch { every: settings.watch_every, show: &mut show });
    let solution = solve(&elements, lit, &probes, &direct, &params, watch, progress)?;
    dump.patches("solution", lit.ground, |i| elements.read(&solution.irradiance, i))?;

    let gathered = match settings.gather() {
        Gather::None => read_elements(lit, &elements, &probes, &direct, &solution, progress)?,
        _ => {
            let sources = Sources::new(lit, &direct, &elements, &solution, settings.max_bounces);
            gather(lit, &sources, &direct, &settings.gather_params(), progress)?
        }
    };
    dump.patches("indirect", lit.ground, |i| gathered.indirect[i])?;
    drop(probes);
    let backs = Backs::of_elements(&elements, &solution);
    let groups = Vec::new();
    Ok(Found { direct, elements, solution, gathered, backs, exchanged: None, groups, left_out, caustics })
}

/// True where a bake needs methods that follow rays with full materials; scenes that are all diffuse, without media, are traced by
/// [`trace`], whose paths tell direct light apart and add up to a balance of energy.
pub fn needs_walks(scene: &Scene, settings: &Settings) -> bool {
    let is_full = settings.surfaces == Surfaces::Full;
    let uses = |s: &Surface| {
        scene.meshes[s.mesh].triangle_material.iter().any(|&m| scene.materials[m as usize].appearance.is_some())
    };
    match settings.method {
        Method::Radiosity => false,
        Method::Path => {
            settings.time_budget.is_some() || !scene.media.is_empty() || is_full && scene.surfaces.iter().any(uses)
        }
        Method::Ray | Method::Bidirectional | Method::Metropolis | Method::Photon => true,
    }
}

/// An error at `place` of the first of `faults` that holds.
fn refuse_first(place: &str, faults: &[(bool, &str)]) -> Result<()> {
    match faults.iter().find(|(holds, _)| *holds) {
        Some((_, message)) => Err(Error::unsupported(place, format!("{message}, or choose radiosity"))),
        None => Ok(()),
    }
}

/// The light by one of the methods that follow rays. It isn't told apart: all of it counts as light between surfaces.
fn by_walks(lit: &Lit, parts: &[Part], settings: &Settings, dump: &Dump, progress: &dyn Progress) -> Result<Found> {
    let Lit { ground, exposure, lights, .. } = *lit;
    let name = settings.method.name();
    if !parts.is_empty() {
        let message = "tells no light of some lights from that of others; choose radiosity, or bake all of each light";
        return Err(Error::invalid(format!("method {name}"), message));
    }
    let is_apart = |kind: &LayerKind| {
        matches!(kind, LayerKind::Direct | LayerKind::Indirect | LayerKind::Bounces | LayerKind::LightGroups)
    };
    refuse_first(
        &format!("method {name}"),
        &[
            (settings.layers.iter().any(is_apart), "tells no parts of the light apart; leave those layers out"),
            (settings.directional != Directional::Off, "doesn't tell where light comes from; leave directional out"),
            (settings.probes.is_some(), "has no probes; leave them out"),
        ],
    )?;
    let scattering = Scattering::new(ground.scene, settings.surfaces);
    let media = Media::new(ground.scene);
    let world = World::new(ground.scene, ground.tracer, lights, &scattering, &media);
    let texels = Texels { ground, exposure, shading_normals: settings.normals == Normals::Shading };
    let film = measure(&world, &texels, settings, progress, |_| Ok(()))?;
    let irradiance = film.mean();
    let standard_error: Vec<Rgb> = film.standard_error().into_iter().map(Rgb::splat).collect();
    dump.patches("error", ground, |i| standard_error[i])?;
    let nothing = || vec![Rgb::ZERO; irradiance.len()];
    let transport = Arc::new(nothing());
    let shown = Sparse::same(Arc::clone(&transport));
    let direct = Direct { transport, shown, inflow: glam::DVec3::ZERO, rays: 0 };
    let gathered = Gathered {
        sky: nothing(),
        difference: film.difference(),
        standard_error,
        indirect: irradiance.clone(),
        parts: Vec::new(),
        groups: Vec::new(),
        moments: Vec::new(),
        landed_share: vec![0.0; irradiance.len()],
        noise: film.noise(),
        sky_inflow: glam::DVec3::ZERO,
        rays: 0,
        irradiance,
    };
    let (elements, solution) = (Elements::default(), Solution::default());
    let backs = Backs::default();
    let (groups, caustics) = (Vec::new(), Brought::default());
    Ok(Found { direct, elements, solution, gathered, backs, exchanged: None, groups, left_out: None, caustics })
}

/// The light by paths. What comes straight from the sky counts as direct light here; of the elements, only the backs get light.
fn paths(
    lit: &Lit,
    parts: &[Part],
    elements: Elements,
    settings: &Settings,
    dump: &Dump,
    progress: &dyn Progress,
) -> Result<Found> {
    if !parts.is_empty() {
        let message = "paths don't tell direct light of some lights from that of others; choose another method, or bake all \
                       of each light";
        return Err(Error::invalid("method path", message));
    }
    let params = settings.path_params();
    let traced = trace(lit, &params, progress)?;
    let backs = trace_backs(lit, &elements, &params, progress)?;
    dump.patches("direct", lit.ground, |i| traced.direct[i])?;
    dump.patches("error", lit.ground, |i| traced.standard_error[i])?;
    let noise = traced.noise(lit.exposure);
    let indirect: Vec<Rgb> = traced.irradiance.iter().zip(&traced.direct).map(|(e, d)| *e - *d).collect();
    dump.patches("indirect", lit.ground, |i| indirect[i])?;
    let [difference, mut direct_difference] = traced.difference;
    let mut direct = traced.direct;
    let mut irradiance = traced.irradiance;
    if settings.denoise_params().filter != Denoise::Off {
        // Here the noise of direct light is known as well.
        Scales::SINGLE.filter(lit, &mut direct, &mut direct_difference, &mut [], progress)?;
        irradiance = direct.iter().zip(&indirect).map(|(d, i)| *d + *i).collect();
    }
    let transport = Arc::new(direct);
    let shown = Sparse::same(Arc::clone(&transport));
    let direct = Direct { transport, shown, inflow: traced.inflow, rays: traced.rays };
    let gathered = Gathered {
        sky: vec![Rgb::ZERO; irradiance.len()],
        irradiance,
        difference,
        standard_error: traced.standard_error,
        indirect,
        parts: Vec::new(),
        groups: Vec::new(),
        moments: traced.moments,
        landed_share: traced.landed_share,
        noise,
        sky_inflow: glam::DVec3::ZERO,
        rays: 0,
    };
    let solution = Solution {
        irradiance: backs.irradiance,
        landed_share: backs.landed_share,
        inflow: backs.inflow,
        rays: backs.rays,
        ..Solution::default()
    };
    let backs = Backs::of_elements(&elements, &solution);
    let (groups, caustics) = (Vec::new(), Brought::default());
    Ok(Found { direct, elements, solution, gathered, backs, exchanged: None, groups, left_out: None, caustics })
}
