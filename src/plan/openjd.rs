//! A plan as a job template of Open Job Description (specification version 2023-09), which render farms take: a task for each shard, and one
//! that ends the bake once all of them are done.
//!
//! Whatever a machine may have elsewhere is a job parameter, so that it can be given and mapped: the scene, plan, cache and output, and
//! the program. Their defaults lie within the folder of the template, as the specification's tools ask for; a scene that lies elsewhere
//! has none and must be named.

use super::{OUTPUT, PLAN_FILE, Plan, below};
use std::path::Path;

/// After which time a task that hangs is ended [s]: a day.
const TIMEOUT: u32 = 24 * 3600;

/// How long a task has to stop once it is asked to [s]; it takes less than one.
const GRACE: u32 = 5;

/// Characters of a scene's name in the job's, at most; a job's name has 128.
const NAME: usize = 100;

/// The template of `plan`, as YAML.
pub fn template(plan: &Plan) -> String {
    let scene = below(&plan.folder, &plan.scene);
    let cache = below(&plan.folder, &plan.cache);
    let parameters = [
        path("Scene", Some(scene.as_path()), "FILE", "IN", "The scene, as it was when the bake was planned"),
        path("Plan", Some(Path::new(PLAN_FILE)), "FILE", "IN", "The plan of the bake"),
        path(
            "Cache",
            Some(cache.as_path()),
            "DIRECTORY",
            "INOUT",
            "What shards share: a folder that all machines reach",
        ),
        path("Output", Some(Path::new(OUTPUT)), "DIRECTORY", "OUT", "Where the bake is written to"),
        "  - name: Lumel\n    type: STRING\n    default: lumel\n    description: The program\n".to_string(),
    ];
    let shard = format!("{{{{Task.Param.Shard}}}}/{}", plan.shards);
    let bake = ["bake", "{{Param.Scene}}", "--plan", "{{Param.Plan}}", "--cache", "{{Param.Cache}}", "--shard", &shard];
    let merge = ["merge", "{{Param.Plan}}", "{{Param.Scene}}", "--cache", "{{Param.Cache}}", "-o", "{{Param.Output}}"];
    let shards = plan.shards;
    format!(
        "specificationVersion: jobtemplate-2023-09\n\
         name: {name}\n\
         parameterDefinitions:\n{parameters}\
         steps:\n\
         \x20 - name: Bake\n\
         \x20   parameterSpace:\n\
         \x20     taskParameterDefinitions:\n\
         \x20       - name: Shard\n\
         \x20         type: INT\n\
         \x20         range: \"1-{shards}\"\n{bake}\
         \x20 - name: Merge\n\
         \x20   dependencies:\n\
         \x20     - dependsOn: Bake\n{merge}",
        name = quoted(&name(&plan.scene)),
        parameters = parameters.concat(),
        bake = script(&bake),
        merge = script(&merge),
    )
}

/// A job parameter that is a path; one that lies outside of the template's folder has no default.
fn path(name: &str, default: Option<&Path>, kind: &str, flow: &str, description: &str) -> String {
    let is_inside = |path: &&Path| path.is_relative();
    let default = default.filter(is_inside).map_or_else(String::new, |path| {
        format!("    default: {}\n", quoted(&path.to_string_lossy().replace('\\', "/")))
    });
    format!(
        "  - name: {name}\n    type: PATH\n    objectType: {kind}\n    dataFlow: {flow}\n{default}    description: {}\n",
        quoted(description)
    )
}

/// What a step runs.
fn script(args: &[&str]) -> String {
    let args: Vec<String> = args.iter().chain(&["--log-format", "openjd"]).map(|arg| quoted(arg)).collect();
    format!(
        "    script:\n\
         \x20     actions:\n\
         \x20       onRun:\n\
         \x20         command: \"{{{{Param.Lumel}}}}\"\n\
         \x20         args: [{args}]\n\
         \x20         timeout: {TIMEOUT}\n\
         \x20         cancelation:\n\
         \x20           mode: NOTIFY_THEN_TERMINATE\n\
         \x20           notifyPeriodInSeconds: {GRACE}\n",
        args = args.join(", "),
    )
}

/// The job's name: braces would be read as a format string, and control characters aren't allowed.
fn name(scene: &Path) -> String {
    let stem = scene.file_stem().unwrap_or_default().to_string_lossy();
    let plain = |c: char| if c.is_control() || c == '{' || c == '}' { '_' } else { c };
    format!("Lumel {}", stem.chars().take(NAME).map(plain).collect::<String>())
}

/// Text as YAML reads it: JSON's strings are strings of YAML.
fn quoted(text: &str) -> String {
    serde_json::Value::from(text).to_string()
}
