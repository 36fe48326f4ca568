//! Fabrication Information Modeling: the wall to print, its layers, their curves and process parameters.
//!
//! Two shapes are read alike: an element (IfcWall, IfcElementAssembly, …) that `IfcRelAggregates` divides into layers, and
//! the published system's project → component → layers. What is aggregated is the layers where it is marked so (ObjectType
//! `FIM_LAYER`, or a property set `FIM_LayerProcess`), else everything. A layer's path is the one item of its
//! representation `Toolpath`, `Axis` or `Slice`, in this order. Process parameters are in property set
//! `FIM_ProcessDefaults` of the wall, and `FIM_LayerProcess` of a layer overrides them.

mod process;

pub use process::Process;

use super::error::ModelError;
use super::ifc::curve::{Curves, Piece};
use super::ifc::placement::{outer_from_local, world_from_local};
use super::ifc::units::{LENGTH, Units, factor_of};
use super::p21::{File, Record, Value};
use crate::plan::path::Segment;
use process::{LAYER_PSET, Properties, WALL_PSET};
use screed_kernel::pose::Pose;
use std::collections::{BTreeMap, HashMap};
use std::path::Path;

/// Representation identifiers of a layer's path, the most specific first.
const TOOLPATHS: [&str; 3] = ["Toolpath", "Axis", "Slice"];
/// Declared and actual path length may differ by this much of the declared one.
const PATH_LENGTH_TOLERANCE: f64 = 1e-3;

/// What is to be printed.
#[derive(Clone, Debug)]
pub struct FimModel {
    /// The schema that the header names, several separated by ", "; empty when it names none. For display only.
    pub schema: String,
    /// The wall's name, or its type and number when it has none.
    pub name: String,
    /// The wall's GlobalId.
    pub wall_guid: String,
    /// Where the wall's own placement, the part frame, lies in the site's coordinates (m).
    pub site_from_part: Pose,
    /// In the order of printing, from the bottom; at least one.
    pub layers: Vec<Layer>,
}

/// One layer.
#[derive(Clone, Debug)]
pub struct Layer {
    /// Place in the order of printing, from 0.
    pub index: usize,
    /// Its name in the file, or its type and number when it has none.
    pub name: String,
    /// Its GlobalId.
    pub guid: String,
    /// Its number in the file.
    pub entity: u64,
    /// The tool's path in the part frame (m): at least one segment, each starting where the one before it ends, to within
    /// the tolerance that [`super::ifc::curve`] states.
    pub segments: Vec<Segment>,
    /// How to print it.
    pub process: Process,
}

impl Layer {
    /// Length of the path (m).
    pub fn length(&self) -> f64 {
        self.segments.iter().map(Segment::length).sum()
    }
}

/// Reads the FIM model in the IFC file at `path`.
pub fn read(path: &Path) -> Result<FimModel, ModelError> {
    let name = path.display().to_string();
    match std::fs::read(path) {
        Ok(text) => parse(&name, &text),
        Err(source) => Err(ModelError::Unreadable { file: name, source }),
    }
}

/// Reads the FIM model in an IFC file's text; `name` is for messages.
pub fn parse(name: &str, text: &[u8]) -> Result<FimModel, ModelError> {
    let file = File::parse(name, text)?;
    let relations = Relations::read(&file)?;
    let (wall, layers) = find_wall(&file, &relations)?;
    let units = Units::read(&file)?;
    let placement = wall.follow_if_given(5, "ObjectPlacement")?;
    let reader = Reader {
        units: &units,
        relations: &relations,
        placement: placement.as_ref().map(Record::id),
        // An element that has no shape of its own need not have a placement; it then is where the site is.
        site_from_part: placement.map_or(Ok(Pose::identity()), |local| world_from_local(&local, units.length))?,
        defaults: Properties::read(&wall, &relations.definitions_of(&wall), WALL_PSET)?,
    };
    let mut found = Vec::with_capacity(layers.len());
    for id in layers {
        found.push(reader.layer(&wall.open(id)?)?);
    }
    Ok(FimModel {
        schema: file.schemas().join(", "),
        name: display_name(&wall)?,
        wall_guid: wall.text(0, "GlobalId")?,
        site_from_part: reader.site_from_part,
        layers: in_order(&wall, found)?,
    })
}

/// Who is made of whom, and who has which property sets.
struct Relations {
    /// Aggregated parts by whole; ordered, so that messages name the same wall every time.
    parts: BTreeMap<u64, Vec<u64>>,
    /// Property sets and quantities by object.
    definitions: HashMap<u64, Vec<u64>>,
}

impl Relations {
    fn read(file: &File<'_>) -> Result<Self, ModelError> {
        let mut parts: BTreeMap<u64, Vec<u64>> = BTreeMap::new();
        for relation in file.all("IFCRELAGGREGATES") {
            let relation = relation?;
            let whole = parts.entry(relation.reference(4, "RelatingObject")?).or_default();
            whole.extend(relation.references(5, "RelatedObjects")?);
        }
        let mut definitions: HashMap<u64, Vec<u64>> = HashMap::new();
        for relation in file.all("IFCRELDEFINESBYPROPERTIES") {
            let relation = relation?;
            let sets = match relation.value(5, "RelatingPropertyDefinition")? {
                Value::Ref(id) => vec![*id],
                // IfcPropertySetDefinitionSet, IFC4's list of several
                Value::Typed(_, values) => match values.as_slice() {
                    [Value::List(sets)] => sets
                        .iter()
                        .map(|set| relation.as_reference(set, "RelatingPropertyDefinition"))
                        .collect::<Result<_, _>>()?,
                    _ => return Err(relation.wrong("RelatingPropertyDefinition", "property sets", "something else")),
                },
                other => return Err(relation.wrong_value("RelatingPropertyDefinition", "a property set", other)),
            };
            for object in relation.references(4, "RelatedObjects")? {
                definitions.entry(object).or_default().extend(&sets);
            }
        }
        Ok(Self { parts, definitions })
    }

    fn definitions_of(&self, object: &Record<'_>) -> Vec<u64> {
        self.definitions.get(&object.id()).cloned().unwrap_or_default()
    }

    /// Whether the object says by its ObjectType or a property set that it is the FIM wall, or a layer.
    fn is_marked(&self, object: &Record<'_>, object_type: &str, pset: &str) -> Result<bool, ModelError> {
        if matches!(object.attributes.get(4), Some(Value::Text(text)) if *text == object_type.as_bytes()) {
            return Ok(true);
        }
        for id in self.definitions_of(object) {
            let set = object.open(id)?;
            if matches!(set.attributes.get(2), Some(Value::Text(text)) if *text == pset.as_bytes()) {
                return Ok(true);
            }
        }
        Ok(false)
    }
}

/// The wall and its layers' numbers.
fn find_wall<'f>(file: &'f File<'f>, relations: &Relations) -> Result<(Record<'f>, Vec<u64>), ModelError> {
    let (mut marked, mut shaped) = (Vec::new(), Vec::new());
    for (&whole, parts) in &relations.parts {
        let Some(instance) = file.get(whole) else { continue };
        let wall = file.record_of(instance)?;
        let mut layers = Vec::new();
        let mut with_path = 0;
        for &part in parts {
            let part = wall.open(part)?;
            with_path += usize::from(toolpath(&part)?.is_some());
            if relations.is_marked(&part, "FIM_LAYER", LAYER_PSET)? {
                layers.push(part.id());
            }
        }
        if !layers.is_empty() {
            marked.push((wall, layers));
        } else if relations.is_marked(&wall, "FIM", WALL_PSET)? {
            marked.push((wall, parts.clone()));
        } else if with_path == parts.len() {
            shaped.push((wall, parts.clone()));
        }
    }
    let mut candidates = if marked.is_empty() { shaped } else { marked };
    match (candidates.pop(), candidates.as_slice()) {
        (Some(only), []) => Ok(only),
        (Some((last, _)), others) => {
            let mut found = Vec::new();
            for wall in others.iter().map(|(wall, _)| wall).chain([&last]) {
                found.push(format!("#{} '{}'", wall.id(), display_name(wall)?));
            }
            Err(ModelError::Ambiguous {
                file: file.name().to_owned(),
                what: "one FIM wall a file is printed",
                found: found.join(", "),
                remedy: "export each wall to a file of its own",
            })
        }
        (None, _) => Err(ModelError::Missing {
            file: file.name().to_owned(),
            missing: "a FIM wall (an element aggregated of layers with a representation Axis, Toolpath or Slice)"
                .to_owned(),
            remedy: "export the fabrication model, with IfcRelAggregates from the wall to its layers".to_owned(),
        }),
    }
}

/// The representation of an element that holds its path.
fn toolpath<'f>(element: &Record<'f>) -> Result<Option<Record<'f>>, ModelError> {
    // What is aggregated need not be a product: look before asking for a shape.
    let Some(Value::Ref(shape)) = element.attributes.get(6) else { return Ok(None) };
    let shape = element.open(*shape)?;
    if shape.keyword != "IFCPRODUCTDEFINITIONSHAPE" {
        return Ok(None);
    }
    let mut best = None;
    for id in shape.references(2, "Representations")? {
        let representation = shape.open(id)?;
        let identifier = representation.text_if_given(1, "RepresentationIdentifier")?;
        let rank = TOOLPATHS.iter().position(|known| Some(*known) == identifier.as_deref());
        if let Some(rank) = rank
            && best.as_ref().is_none_or(|(best_rank, _)| rank < *best_rank)
        {
            best = Some((rank, representation));
        }
    }
    Ok(best.map(|(_, representation)| representation))
}

fn display_name(object: &Record<'_>) -> Result<String, ModelError> {
    let name = object.text_if_given(2, "Name")?.filter(|name| !name.is_empty());
    Ok(name.unwrap_or_else(|| format!("{} #{}", object.keyword, object.id())))
}

/// A layer with what tells its place in the order.
struct Found<'f> {
    record: Record<'f>,
    layer: Layer,
    declared_index: Option<usize>,
    /// Of the path's start above the part frame (m).
    height: f64,
}

/// What reading a layer needs to know of its wall.
struct Reader<'u, 'f> {
    units: &'u Units<'f>,
    relations: &'u Relations,
    placement: Option<u64>,
    site_from_part: Pose,
    defaults: Properties<'f>,
}

impl<'f> Reader<'_, 'f> {
    fn layer(&self, record: &Record<'f>) -> Result<Found<'f>, ModelError> {
        let name = display_name(record)?;
        let representation = toolpath(record)?.ok_or_else(|| {
            let expected = "a representation Axis, Toolpath or Slice with the layer's path";
            record.wrong("Representation", expected, "none")
        })?;
        let [item] = representation.references(3, "Items")?[..] else {
            let found = representation.list(3, "Items")?.len();
            return Err(representation.wrong("Items", "one curve", format!("{found} items")));
        };
        let precision = precision(&representation, self.units.length)?;
        let curve = representation.open(item)?;
        let pieces = Curves::new(self.units, precision, &name).read(&curve)?;
        let definitions = self.relations.definitions_of(record);
        self.check_length(record, &definitions, &name, &curve, &pieces)?;
        let own = Properties::read(record, &definitions, LAYER_PSET)?;
        let process = Process::read(record, &name, &own, &self.defaults, self.units)?;
        let part_from_layer = match record.follow_if_given(5, "ObjectPlacement")? {
            Some(local) => outer_from_local(&local, self.placement, &self.site_from_part, self.units.length)?,
            // Without a placement of its own it lies in the site's coordinates.
            None => self.site_from_part.inverse(),
        };
        let segments: Vec<_> = pieces.iter().map(|piece| piece.segment.transformed(&part_from_layer)).collect();
        let is_finite = |segment: &Segment| (segment.start().coords + segment.end().coords).norm().is_finite();
        let height = match segments.first() {
            Some(first) if segments.iter().all(is_finite) => first.start().z,
            _ => return Err(record.impossible("the path lies beyond all numbers; check points and placements")),
        };
        let declared_index = own.index()?;
        let layer = Layer { index: 0, name, guid: record.text(0, "GlobalId")?, entity: record.id(), segments, process };
        Ok(Found { record: record.open(record.id())?, layer, declared_index, height })
    }

    /// A declared quantity PathLength must be the curve's length.
    fn check_length(
        &self,
        record: &Record<'f>,
        definitions: &[u64],
        layer: &str,
        curve: &Record<'f>,
        pieces: &[Piece],
    ) -> Result<(), ModelError> {
        let actual: f64 = pieces.iter().map(|piece| piece.segment.length()).sum();
        for id in definitions {
            let set = record.open(*id)?;
            if set.keyword != "IFCELEMENTQUANTITY" {
                continue;
            }
            for id in set.references(5, "Quantities")? {
                let quantity = set.open(id)?;
                if quantity.keyword != "IFCQUANTITYLENGTH" || quantity.text(0, "Name")? != "PathLength" {
                    continue;
                }
                let factor = match quantity.follow_if_given(2, "Unit")? {
                    Some(unit) => factor_of(&unit, &LENGTH)?,
                    None => self.units.length,
                };
                let declared = quantity.real(3, "LengthValue")? * factor;
                if (actual - declared).abs() > PATH_LENGTH_TOLERANCE * declared.abs() {
                    return Err(ModelError::PathLength {
                        entity: quantity.entity(),
                        layer: layer.to_owned(),
                        curve: curve.id(),
                        declared_mm: declared * 1e3,
                        actual_mm: actual * 1e3,
                    });
                }
            }
        }
        Ok(())
    }
}

/// Precision (m) of the context of a representation; sub-contexts inherit their parent's.
fn precision(representation: &Record<'_>, length: f64) -> Result<Option<f64>, ModelError> {
    let mut context = representation.follow(0, "ContextOfItems")?;
    // A sub-context's parent is a context; anything deeper is not IFC.
    if context.keyword == "IFCGEOMETRICREPRESENTATIONSUBCONTEXT" {
        context = context.follow(6, "ParentContext")?;
    }
    if context.keyword != "IFCGEOMETRICREPRESENTATIONCONTEXT" {
        return Err(representation.wrong("ContextOfItems", "IFCGEOMETRICREPRESENTATIONCONTEXT", context.keyword));
    }
    match context.given(3, "Precision")? {
        Some(value) => Ok(Some(context.as_real(value, "Precision")? * length)),
        None => Ok(None),
    }
}

/// Layers from the bottom: by LayerIndex where they have it, else by the height of their path's start. An index must not
/// contradict the heights, or the nozzle would run into what it printed.
fn in_order(wall: &Record<'_>, mut found: Vec<Found<'_>>) -> Result<Vec<Layer>, ModelError> {
    if found.is_empty() {
        return Err(wall.wrong("RelatedObjects", "at least one layer", "none"));
    }
    found.sort_by(|a, b| a.declared_index.cmp(&b.declared_index).then(a.height.total_cmp(&b.height)));
    let indexed = found.iter().any(|layer| layer.declared_index.is_some());
    for (lower, upper) in found.iter().zip(found.iter().skip(1)) {
        let problem = match (lower.declared_index, upper.declared_index) {
            (None, Some(_)) => format!("other layers have a LayerIndex, '{}' has none", lower.layer.name),
            (Some(a), Some(b)) if a == b => format!("LayerIndex {b} is that of '{}', too", lower.layer.name),
            (Some(_), Some(_)) if upper.height < lower.height - 1e-6 => format!(
                "its LayerIndex is above that of '{}', but its path starts {:.3} mm lower",
                lower.layer.name,
                (lower.height - upper.height) * 1e3
            ),
            _ if !indexed && upper.height - lower.height < 1e-6 => {
                format!("starts as high as '{}', and neither has a LayerIndex", lower.layer.name)
            }
            _ => continue,
        };
        return Err(ModelError::LayerOrder { entity: upper.record.entity(), name: upper.layer.name.clone(), problem });
    }
    Ok(found.into_iter().enumerate().map(|(index, found)| Layer { index, ..found.layer }).collect())
}

#[cfg(test)]
mod tests;
