//! `lumel form-factors`: the matrix of form factors to a file, and how good it is to stdout.

use super::args::FormFactorArgs;
use super::bake::workers;
use super::config::{self, Resolved};
use super::console::Console;
use super::failure::Failure;
use super::print::{self, Table, count, number};
use super::{destination, interrupt};
use lumel::Error;
use lumel::pipeline;
use lumel::view_factors::Figures;
use lumel::write::view_factors::method_name;
use std::path::{Path, PathBuf};
use std::time::Instant;

/// `lumel form-factors`.
///
/// # Errors
/// `Usage` where the settings are wrong, else the library's.
pub fn form_factors(args: &FormFactorArgs, console: &Console) -> Result<(), Failure> {
    let start = Instant::now();
    let scene = args.scene.path();
    let Resolved { settings, file } = config::resolve(args)?;
    settings.view_factor_params().map_err(|e| match e {
        Error::Invalid { place, message } => Failure::Usage(Error::invalid(format!("--{place}"), message)),
        e => Failure::Run(e),
    })?;
    let named = || PathBuf::from(format!("{}_form_factors.npz", destination::stem(scene)));
    let output = args.output.clone().unwrap_or_else(named);
    if let Some(config) = file.filter(|f| matches!((f.canonicalize(), output.canonicalize()), (Ok(a), Ok(b)) if a == b))
    {
        let message = "would be replaced by the result; give another file with -o";
        return Err(Error::invalid(config.display(), message).into());
    }

    let folder = output.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."));
    interrupt::install(console, console.cancel_flag(), Some(folder.to_path_buf()));
    let figures = workers(&settings)?.install(|| pipeline::form_factors(scene, &output, &settings, console))?;
    console.finish();
    console.warnings(&figures.warnings);
    console.done(&output, &[], start.elapsed().as_secs_f64());
    if args.json { print::json(&figures) } else { print::print(&text(&figures)) }
}

fn text(f: &Figures) -> String {
    let percent = |v: f64| format!("{} %", number(100.0 * v));
    let mut table = Table::new(&["figure", ">value", ""]);
    let mut row = |name: &str, value: String, note: &str| table.row(vec![name.into(), value, note.into()]);
    row("elements", count(f.elements as u64), "");
    row("method", method_name(f.method).into(), "");
    row("asked error", percent(f.relative_error.into()), "of each form factor, or of the mean 1 / n");
    row("row sums", number(f.row_sums.mean), "mean");
    row("", percent(f.row_sums.rms_error), "RMS against what rays saw land");
    row("", percent(f.row_sums.worst_error), "worst");
    row("reciprocity", percent(f.reciprocity_error), "RMS(A_i F_ij - A_j F_ji) / RMS(A_i F_ij)");
    row("escaping", percent(f.escaping), "of what leaves all elements lands on none");
    let mut text = table.text();
    let mut heading: Vec<String> = ["surface", ">elements", ">area [m^2]"].map(String::from).to_vec();
    let numbered = f.surface_form_factors.as_ref();
    if numbered.is_some() {
        heading.extend((1..=f.surfaces.len()).map(|k| format!(">to {k}")));
    }
    let heading: Vec<&str> = heading.iter().map(String::as_str).collect();
    let mut table = Table::new(&heading);
    for (k, s) in f.surfaces.iter().enumerate() {
        let mut cells = vec![format!("{} {}", k + 1, s.name), count(s.elements as u64), number(s.area)];
        cells.extend(numbered.iter().flat_map(|rows| &rows[k]).map(|v| format!("{v:.4}")));
        table.row(cells);
    }
    text += &format!("\nsurfaces: {}\n{}", f.surfaces.len(), table.text());
    text
}
