//! `lumel compare`.
use super::args::CompareArgs;
use super::failure::Failure;

/// `lumel compare`.
pub fn compare(_args: &CompareArgs) -> Result<(), Failure> {
    Ok(())
}
