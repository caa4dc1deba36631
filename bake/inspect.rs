//! `lumel inspect`: what a bake would see, as tables or JSON.

use super::args::InspectArgs;
use super::config;
use super::console::Console;
use super::failure::Failure;
use super::print::{self, Table, count, number};
use lumel::color::{Rgb, luminance};
use lumel::inspect::{Inspection, inspect as look};

/// `lumel inspect`.
///
/// # Errors
/// `Usage` where the settings are wrong, else the loader's.
pub fn inspect(args: &InspectArgs, console: &Console) -> Result<(), Failure> {
    let settings = config::resolve(args)?.settings;
    let loaded = lumel::load::load_with(&args.scene.scene, &settings.load_options())?;
    let inspection = look(&loaded, &settings);
    if args.json {
        return print::json(&inspection);
    }
    print::print(&text(&inspection))?;
    console.warnings(&inspection.warnings);
    Ok(())
}

fn text(i: &Inspection) -> String {
    [surfaces(i), lights(i), totals(i)].join("\n")
}

fn surfaces(i: &Inspection) -> String {
    let mut table =
        Table::new(&["surface", "mesh", ">triangles", ">area [m^2]", ">albedo", "materials", ">emits [lm]"]);
    for s in &i.surfaces {
        let [low, high] = s.albedo.map(|c| f64::from(luminance(Rgb::from_array(c))));
        let albedo = if (high - low).abs() < 5e-4 { format!("{low:.3}") } else { format!("{low:.3} - {high:.3}") };
        let power = if s.emissive_area > 0.0 { number(s.emissive_power) } else { String::new() };
        table.row(vec![
            s.name.clone(),
            s.mesh.clone(),
            count(s.triangles as u64),
            number(s.area),
            albedo,
            s.materials.join(", "),
            power,
        ]);
    }
    let mut text = format!("surfaces: {}\n{}", i.surfaces.len(), table.text());
    if !i.shared_meshes.is_empty() {
        let mut shared = Table::new(&["mesh", ">surfaces"]);
        i.shared_meshes.iter().for_each(|m| shared.row(vec![m.name.clone(), count(m.surfaces as u64)]));
        text += &format!("\nshared meshes: {}\n{}", i.shared_meshes.len(), shared.text());
    }
    text
}

fn lights(i: &Inspection) -> String {
    let mut table = Table::new(&["light", "kind", ">R G B", "unit", ">area [m^2]", ">power [lm]", ""]);
    for l in &i.lights {
        let optional = |v: Option<f64>| v.map_or_else(String::new, number);
        let note = if l.shaped { "shaped; power without it" } else { "" };
        let cells = [&l.name, l.kind, &triple(l.value, " "), l.unit, &optional(l.area), &optional(l.power), note];
        table.row(cells.map(str::to_string).to_vec());
    }
    let mut text = format!("lights: {}\n{}", i.lights.len(), table.text());
    if let Some(e) = &i.environment {
        let picture = e.texture.as_ref().map_or_else(String::new, |(name, [w, h])| format!(", {name}, {w} x {h}"));
        text += &format!("sky: {}, {} nit{picture}\n", e.name, triple(e.radiance, " "));
    }
    if i.emissive_area > 0.0 {
        text += &format!("emissive: {} m^2, {} lm\n", number(i.emissive_area), number(i.emissive_power));
    }
    if !i.has_light {
        text += "nothing shines: a bake needs --sky or --environment\n";
    }
    text
}

fn totals(i: &Inspection) -> String {
    let [low, high] = i.bounds;
    let size = std::array::from_fn(|k| high[k] - low[k]);
    let e = &i.estimate;
    let mut table = Table::new(&["total", ""]);
    let mut row = |name: &str, value: String| table.row(vec![name.into(), value]);
    row("size", format!("{} m", triple(size, " x ")));
    row("bounds", format!("{} to {} m", triple(low, " "), triple(high, " ")));
    row("triangles", count(i.triangles as u64));
    row("area", format!("{} m^2", number(i.area)));
    row("density", format!("about {} texels per metre", number(e.density)));
    row("texels", format!("about {}", count(e.texels)));
    row("pages", format!("about {} of up to {} x {}", e.pages, e.page_size, e.page_size));
    table.text()
}

fn triple(v: [f32; 3], between: &str) -> String {
    v.map(|v| number(f64::from(v))).join(between)
}
