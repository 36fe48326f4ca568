//! What IFC's units, placements and curves mean: IFC 2x3, 4 and 4.3 alike, told apart by entity names, never by the header.
//!
//! Everything leaves here in metres, seconds and radians.

pub mod curve;
pub mod placement;
pub mod units;

use crate::model::error::ModelError;
use crate::model::p21::{File, Record};

/// The file's project: the one `IfcProject`, which owns the units.
pub fn project<'f>(file: &'f File<'f>) -> Result<Record<'f>, ModelError> {
    let mut projects = file.all("IFCPROJECT");
    let first = projects.next().transpose()?;
    let project = first.ok_or_else(|| ModelError::Missing {
        file: file.name().to_owned(),
        missing: "an IfcProject".to_owned(),
        remedy: "export the whole project, not a part of it".to_owned(),
    })?;
    match projects.next().transpose()? {
        None => Ok(project),
        Some(second) => Err(ModelError::Ambiguous {
            file: file.name().to_owned(),
            what: "one IfcProject is needed",
            found: format!("#{} and #{}", project.id(), second.id()),
            remedy: "export one project a file",
        }),
    }
}
