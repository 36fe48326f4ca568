//! Why a model cannot be read: where, what was expected, what was found, what to do about it.

use crate::failure::{Excerpt, Exit, Failure};
use std::fmt;
use std::ops::Range;

/// A place in a model file.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Place {
    /// The file's name as it was given.
    pub file: String,
    /// Line, from 1.
    pub line: usize,
    /// Column, from 1, counted in bytes.
    pub column: usize,
    /// The bytes meant, from the start of the file.
    pub span: Range<usize>,
}

impl fmt::Display for Place {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(out, "{}:{}:{}", self.file, self.line, self.column)
    }
}

/// An entity of a model file, as a message names it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Entity {
    /// Where it stands.
    pub place: Place,
    /// The number behind the `#`.
    pub id: u64,
    /// Its type, in capitals as in the file.
    pub keyword: String,
}

impl fmt::Display for Entity {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(out, "{}: #{} {}", self.place, self.id, self.keyword)
    }
}

/// Why a model cannot be read.
#[derive(Debug, thiserror::Error)]
pub enum ModelError {
    /// The operating system does not give the file's bytes.
    #[error("{file}: cannot be read: {source}; check the path and the permissions")]
    Unreadable {
        /// The file's name.
        file: String,
        /// What the operating system says.
        source: std::io::Error,
    },
    /// The text ends too early.
    #[error(
        "{place}: the file ends inside {inside}, expected {expected}; it is cut short or this is never closed: export it or copy it again"
    )]
    Truncated {
        /// Where the thing that is cut short begins.
        place: Place,
        /// What is cut short.
        inside: String,
        /// What should have come.
        expected: String,
    },
    /// The text is no ISO 10303-21.
    #[error(
        "{place}: expected {expected}, found {found}; the text breaks the rules of ISO 10303-21: correct it or export it again"
    )]
    Syntax {
        /// Where.
        place: Place,
        /// What the rules want here.
        expected: String,
        /// What stands there.
        found: String,
    },
    /// Two entities share one number.
    #[error("{entity}: the number was used before, in line {first_line}; give each entity a number of its own")]
    DuplicateId {
        /// The second one.
        entity: Box<Entity>,
        /// Line of the first.
        first_line: usize,
    },
    /// A reference leads nowhere.
    #[error("{entity}: refers to #{target}, which is not in the file; export the model again, complete")]
    Dangling {
        /// Who refers.
        entity: Box<Entity>,
        /// The number that is missing.
        target: u64,
    },
    /// An attribute is not what its entity needs.
    #[error("{entity}: attribute {attribute}: expected {expected}, found {found}; correct it in the authoring program")]
    Attribute {
        /// Whose attribute.
        entity: Box<Entity>,
        /// Its name in the schema.
        attribute: &'static str,
        /// What it should be.
        expected: String,
        /// What it is.
        found: String,
    },
    /// A curve or placement of a type that cannot be printed.
    #[error("{entity}: unsupported {what}{of}; write it as {instead}")]
    Unsupported {
        /// The entity that is not supported.
        entity: Box<Entity>,
        /// What role it plays: segment, placement, unit.
        what: &'static str,
        /// " in 'NAME'" where an element of that name owns it, else empty.
        of: String,
        /// Types that are supported.
        instead: &'static str,
    },
    /// References run in a circle or are nested deeper than any model needs.
    #[error("{entity}: nested deeper than {limit}; look for an entity that refers to itself")]
    TooDeep {
        /// Where the limit was reached.
        entity: Box<Entity>,
        /// The limit.
        limit: usize,
    },
    /// More than a layer may have.
    #[error("{entity}: more than {limit} segments in one curve; split the layer or thin out its points")]
    TooLarge {
        /// Where the limit was reached.
        entity: Box<Entity>,
        /// The limit.
        limit: usize,
    },
    /// The project assigns no such unit.
    #[error(
        "{entity}: no {unit} is assigned, needed for {needed_for}; add {remedy} to the project's IfcUnitAssignment"
    )]
    MissingUnit {
        /// The unit assignment, or the project when there is none.
        entity: Box<Entity>,
        /// Name of the unit type that is missing, as in IFC: `LENGTHUNIT`.
        unit: &'static str,
        /// What needs it.
        needed_for: String,
        /// The entity to add.
        remedy: &'static str,
    },
    /// A unit measures something else.
    #[error("{entity}: a unit of {expected} was expected, found one of {found}; give it in the right unit")]
    WrongUnit {
        /// The unit or the property that carries it.
        entity: Box<Entity>,
        /// What it should measure.
        expected: String,
        /// What it measures.
        found: String,
    },
    /// The geometry of one curve is impossible.
    #[error("{entity}: {problem}")]
    Geometry {
        /// The curve.
        entity: Box<Entity>,
        /// What is wrong with it, with figures, and what to do.
        problem: String,
    },
    /// Two consecutive segments do not meet.
    #[error(
        "{next}: starts {gap_mm:.6} mm from where #{previous} {previous_keyword} (line {previous_line}) ends, allowed are \
         {allowed_mm:.6} mm; move the end points together or set the senses right"
    )]
    Gap {
        /// The later segment's curve.
        next: Box<Entity>,
        /// Number of the earlier segment's curve.
        previous: u64,
        /// Its type.
        previous_keyword: String,
        /// Its line.
        previous_line: usize,
        /// Distance (mm).
        gap_mm: f64,
        /// Distance allowed (mm): see [`crate::model::ifc::curve`].
        allowed_mm: f64,
    },
    /// The file has none of what must be there.
    #[error("{file}: {missing} not found; {remedy}")]
    Missing {
        /// The file's name.
        file: String,
        /// What was looked for.
        missing: String,
        /// What to do.
        remedy: String,
    },
    /// The file has more than one where one is needed.
    #[error("{file}: {what}, but there are {found}; {remedy}")]
    Ambiguous {
        /// The file's name.
        file: String,
        /// What was looked for.
        what: &'static str,
        /// What was found, by number and name.
        found: String,
        /// What to do.
        remedy: &'static str,
    },
    /// A process parameter is absent.
    #[error(
        "{entity} '{name}': no {property}; add it to property set {pset} of the layer, or to FIM_ProcessDefaults of the wall"
    )]
    MissingProperty {
        /// The layer.
        entity: Box<Entity>,
        /// The layer's name.
        name: String,
        /// The property set that should have it.
        pset: &'static str,
        /// The property.
        property: &'static str,
    },
    /// A process parameter has an impossible value.
    #[error("{entity}: property {property} in {pset}: expected {expected}, found {found}; correct the property")]
    Property {
        /// The property.
        entity: Box<Entity>,
        /// The property set.
        pset: String,
        /// The property.
        property: String,
        /// What it should be.
        expected: String,
        /// What it is.
        found: String,
    },
    /// The declared path length is not the curve's.
    #[error(
        "{entity}: PathLength declares {declared_mm:.3} mm, but the curve #{curve} of layer '{layer}' is {actual_mm:.3} mm \
         long; one of them is wrong: export the model again"
    )]
    PathLength {
        /// The quantity.
        entity: Box<Entity>,
        /// Name of the layer.
        layer: String,
        /// Number of the curve.
        curve: u64,
        /// Declared length (mm).
        declared_mm: f64,
        /// Length of the curve (mm).
        actual_mm: f64,
    },
    /// The order of the layers cannot be told.
    #[error("{entity} '{name}': {problem}; number the layers from the bottom with LayerIndex in FIM_LayerProcess")]
    LayerOrder {
        /// The layer.
        entity: Box<Entity>,
        /// Its name.
        name: String,
        /// What contradicts what.
        problem: String,
    },
}

impl ModelError {
    /// Line, column (both from 1) and the bytes to show, when a place in the file is to blame.
    pub fn location(&self) -> Option<(usize, usize, Range<usize>)> {
        let place = match self {
            Self::Unreadable { .. } | Self::Missing { .. } | Self::Ambiguous { .. } => return None,
            Self::Truncated { place, .. } | Self::Syntax { place, .. } => place,
            Self::DuplicateId { entity, .. }
            | Self::Dangling { entity, .. }
            | Self::Attribute { entity, .. }
            | Self::Unsupported { entity, .. }
            | Self::TooDeep { entity, .. }
            | Self::TooLarge { entity, .. }
            | Self::MissingUnit { entity, .. }
            | Self::WrongUnit { entity, .. }
            | Self::Geometry { entity, .. }
            | Self::Gap { next: entity, .. }
            | Self::MissingProperty { entity, .. }
            | Self::Property { entity, .. }
            | Self::PathLength { entity, .. }
            | Self::LayerOrder { entity, .. } => &entity.place,
        };
        Some((place.line, place.column, place.span.clone()))
    }
}

impl ModelError {
    /// What a person is told; `source` is the file's text, for the lines that are to blame.
    pub fn into_failure(self, file: &str, source: &[u8]) -> Failure {
        let failure = Failure::told(Exit::Input, self.to_string());
        match self.location() {
            Some((_, _, span)) => failure.at(Excerpt::new(file, source, span)),
            None => failure,
        }
    }
}
