//! `lumel compare`: error figures of two pages, and an error image.

use super::args::CompareArgs;
use super::failure::Failure;
use super::print::{self, Table, count, number};
use lumel::Error;
use lumel::compare::{Comparison, compare as figures, error_image, read_page, write_png};
use std::path::Path;

/// `lumel compare`.
///
/// # Errors
/// `Usage` where the range is no percentage or the error image would replace a page; else the library's.
pub fn compare(args: &CompareArgs) -> Result<(), Failure> {
    if !(args.range.is_finite() && args.range > 0.0) {
        return Err(Failure::Usage(Error::invalid("--range", format!("{} must be above 0 [%]", args.range))));
    }
    if let Some(output) = &args.output
        && let Some(page) = [&args.test, &args.reference].into_iter().find(|p| is_same_file(p, output))
    {
        return Err(Failure::Usage(Error::invalid(page.display(), "would be replaced by the error image")));
    }
    let (a, b) = (read_page(&args.test)?, read_page(&args.reference)?);
    let place = format!("{} and {}", args.test.display(), args.reference.display());
    let comparison = figures(&a, &b, &place)?;
    if let Some(output) = &args.output {
        write_png(&error_image(&a, &b, f64::from(args.range) / 100.0, &place)?, output)?;
    }
    if args.json { print::json(&comparison) } else { print::print(&text(&comparison)) }
}

fn is_same_file(a: &Path, b: &Path) -> bool {
    matches!((a.canonicalize(), b.canonicalize()), (Ok(a), Ok(b)) if a == b)
}

fn text(c: &Comparison) -> String {
    let percent = |v: f64| format!("{} %", number(100.0 * v));
    let mut table = Table::new(&["figure", ">value", ""]);
    let mut row = |name: &str, value: String, note: &str| table.row(vec![name.into(), value, note.into()]);
    row("texels", count(c.texels as u64), "covered by both");
    row("only A", count(c.only_a as u64), "covered by A alone");
    row("only B", count(c.only_b as u64), "covered by B alone");
    row("not finite", count(c.not_finite as u64), "infinite or NaN in one of them; left out");
    row("mean A", number(c.mean_a), "luminance, in the page's quantity");
    row("mean B", number(c.mean_b), "");
    row("bias", percent(c.bias), "sum(A - B) / sum(B)");
    row("rel RMSE", percent(c.rel_rmse), "RMS(A - B) / mean(B)");
    row("rel RMSE trim", percent(c.rel_rmse_trim), "the same without the worst 1 % of texels");
    row("p50", percent(c.p50), "of |A - B| / max(B, 5 % of mean(B))");
    row("p95", percent(c.p95), "");
    row("p99", percent(c.p99), "");
    row("max", percent(c.max), &format!("at x {} y {}", c.max_at[0], c.max_at[1]));
    format!("{} x {} texels\n{}", c.width, c.height, table.text())
}
