//! Process parameters from property sets, converted to SI.

use crate::model::error::ModelError;
use crate::model::ifc::units::{ACCELERATION, FLOW, LENGTH, Quantity, TIME, Units, VELOCITY};
use crate::model::p21::{Record, Value, describe};
use std::collections::BTreeMap;

/// The wall's property set.
pub(super) const WALL_PSET: &str = "FIM_ProcessDefaults";
/// A layer's property set, which overrides the wall's.
pub(super) const LAYER_PSET: &str = "FIM_LayerProcess";

/// Properties that mean something in these sets; others are none of Screed's business, unless they look misspelt.
const KNOWN: [&str; 9] = [
    "LayerTime",
    "MaxAcceleration",
    "MaxVelocity",
    "NozzleDiameter",
    "LayerHeight",
    "FilamentWidth",
    "ExtrusionRate",
    "LayerIndex",
    "FimSchemaVersion",
];

/// How a layer is to be printed. All positive.
#[derive(Clone, Debug, PartialEq)]
pub struct Process {
    /// Time for the layer's path, lifting and travelling apart (s).
    pub layer_time: f64,
    /// Largest acceleration of the tool along the path (m/s²).
    pub acceleration_max: f64,
    /// Largest speed of the tool (m/s).
    pub velocity_max: Option<f64>,
    /// Diameter of the nozzle's opening (m).
    pub nozzle_diameter: Option<f64>,
    /// Height of the layer (m).
    pub layer_height: f64,
    /// Width of the deposited filament (m).
    pub filament_width: f64,
    /// The extruder's declared rate (m³/s); what is extruded follows the tool's speed.
    pub extrusion_rate: Option<f64>,
}

impl Process {
    /// The parameters of the layer `record`: `own` before `defaults`.
    pub(super) fn read<'f>(
        record: &Record<'f>,
        name: &str,
        own: &Properties<'f>,
        defaults: &Properties<'f>,
        units: &Units<'f>,
    ) -> Result<Self, ModelError> {
        let optional = |property: &'static str, quantity: &Quantity| match own.find(property) {
            Some(found) => own.positive(found, property, quantity, units).map(Some),
            None => {
                defaults.find(property).map(|found| defaults.positive(found, property, quantity, units)).transpose()
            }
        };
        let required = |property: &'static str, quantity: &Quantity| {
            optional(property, quantity)?.ok_or_else(|| ModelError::MissingProperty {
                entity: record.entity(),
                name: name.to_owned(),
                pset: LAYER_PSET,
                property,
            })
        };
        Ok(Self {
            layer_time: required("LayerTime", &TIME)?,
            acceleration_max: required("MaxAcceleration", &ACCELERATION)?,
            velocity_max: optional("MaxVelocity", &VELOCITY)?,
            nozzle_diameter: optional("NozzleDiameter", &LENGTH)?,
            layer_height: required("LayerHeight", &LENGTH)?,
            filament_width: required("FilamentWidth", &LENGTH)?,
            extrusion_rate: optional("ExtrusionRate", &FLOW)?,
        })
    }
}

/// The properties of one object in the sets of one name.
pub(super) struct Properties<'f> {
    pset: &'static str,
    properties: BTreeMap<String, Record<'f>>,
}

impl<'f> Properties<'f> {
    /// Collects them and refuses names that occur twice, look misspelt, or belong to another version of FIM.
    pub(super) fn read(owner: &Record<'f>, definitions: &[u64], pset: &'static str) -> Result<Self, ModelError> {
        let mut found = Self { pset, properties: BTreeMap::new() };
        for id in definitions {
            let set = owner.open(*id)?;
            if set.keyword != "IFCPROPERTYSET" || set.text_if_given(2, "Name")?.as_deref() != Some(pset) {
                continue;
            }
            for id in set.references(4, "HasProperties")? {
                let property = set.open(id)?;
                let name = property.text(0, "Name")?;
                if found.find(&name).is_some() {
                    return Err(found.wrong(&property, &name, "to occur once", "a second one".to_owned()));
                }
                found.check_name(&property, &name)?;
                found.properties.insert(name, property);
            }
        }
        found.check_version()?;
        Ok(found)
    }

    /// A misspelt override would silently print with the default.
    fn check_name(&self, property: &Record<'f>, name: &str) -> Result<(), ModelError> {
        let close = |known: &&str| strsim::osa_distance(&known.to_lowercase(), &name.to_lowercase()) <= 2;
        match KNOWN.iter().find(|known| close(known)) {
            Some(known) if *known != name => {
                Err(self.wrong(property, name, &format!("the name {known}"), format!("'{name}'")))
            }
            _ => Ok(()),
        }
    }

    fn check_version(&self) -> Result<(), ModelError> {
        let Some(property) = self.find("FimSchemaVersion") else { return Ok(()) };
        let version = property.text(2, "NominalValue")?;
        if version == "1" || version.starts_with("1.") {
            return Ok(());
        }
        Err(self.wrong(property, "FimSchemaVersion", "version 1", format!("'{version}'")))
    }

    fn find(&self, name: &str) -> Option<&Record<'f>> {
        self.properties.get(name)
    }

    fn wrong(&self, property: &Record<'f>, name: &str, expected: &str, found: String) -> ModelError {
        ModelError::Property {
            entity: property.entity(),
            pset: self.pset.to_owned(),
            property: name.to_owned(),
            expected: expected.to_owned(),
            found,
        }
    }

    fn nominal<'p>(&self, property: &'p Record<'f>, name: &str) -> Result<&'p Value<'f>, ModelError> {
        if property.keyword != "IFCPROPERTYSINGLEVALUE" {
            return Err(self.wrong(property, name, "an IfcPropertySingleValue", property.keyword.to_owned()));
        }
        property
            .given(2, "NominalValue")?
            .ok_or_else(|| self.wrong(property, name, "a value", "nothing ($)".to_owned()))
    }

    fn positive(
        &self,
        property: &Record<'f>,
        name: &'static str,
        quantity: &Quantity,
        units: &Units<'f>,
    ) -> Result<f64, ModelError> {
        let nominal = self.nominal(property, name)?;
        let unit = property.follow_if_given(3, "Unit")?;
        let needed_for = format!("{name} in {}", self.pset);
        let value = units.value(property, nominal, unit.as_ref(), quantity, &needed_for)?;
        if value > 0.0 && value.is_finite() {
            return Ok(value);
        }
        Err(self.wrong(property, name, &format!("a {} above zero", quantity.name), describe(nominal)))
    }

    /// The layer's place in the order of printing, where declared.
    pub(super) fn index(&self) -> Result<Option<usize>, ModelError> {
        let Some(property) = self.find("LayerIndex") else { return Ok(None) };
        let nominal = self.nominal(property, "LayerIndex")?;
        match nominal {
            Value::Typed(_, values) if matches!(values.as_slice(), [Value::Integer(0..)]) => {
                property.as_count(&values[0], "NominalValue").map(Some)
            }
            other => {
                let expected = "a whole number, not negative, as IFCINTEGER";
                Err(self.wrong(property, "LayerIndex", expected, describe(other)))
            }
        }
    }
}
