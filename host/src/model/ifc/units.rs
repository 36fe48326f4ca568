//! Units of measure: SI units with prefixes, conversion based units and derived units, resolved to a factor to SI and to
//! dimensions, so that a value in the wrong kind of unit is refused.

use super::project;
use crate::model::error::{Entity, ModelError};
use crate::model::p21::{File, Record, Value, describe};
use std::collections::BTreeMap;

/// Exponents of metre, gram, second, ampere, kelvin, mole, candela, as in `IfcDimensionalExponents`. Angles have none.
pub type Dimensions = [i32; 7];

/// Units refer to units refer to units: SI, a conversion of it, a derived unit of that. Deeper is a circle.
const DEPTH_MAX: usize = 8;
/// Seven base units make every derived unit; a bound for files whose references multiply.
const ELEMENTS_MAX: usize = 16;

/// A kind of quantity that Screed reads from models.
#[derive(Debug, PartialEq)]
pub struct Quantity {
    /// As a message names it.
    pub name: &'static str,
    /// The IFC unit type that measures it.
    unit_type: &'static str,
    /// IFC value types that carry it.
    measures: &'static [&'static str],
    dimensions: Dimensions,
    /// What to add where the unit is missing.
    remedy: &'static str,
}

/// Lengths (m).
pub const LENGTH: Quantity = Quantity {
    name: "length",
    unit_type: "LENGTHUNIT",
    measures: &["IFCLENGTHMEASURE", "IFCPOSITIVELENGTHMEASURE", "IFCNONNEGATIVELENGTHMEASURE"],
    dimensions: [1, 0, 0, 0, 0, 0, 0],
    remedy: "IFCSIUNIT(*,.LENGTHUNIT.,.MILLI.,.METRE.) or the unit that the model is in",
};
/// Plane angles (rad).
pub const ANGLE: Quantity = Quantity {
    name: "plane angle",
    unit_type: "PLANEANGLEUNIT",
    measures: &["IFCPLANEANGLEMEASURE", "IFCPOSITIVEPLANEANGLEMEASURE"],
    dimensions: [0; 7],
    remedy: "IFCSIUNIT(*,.PLANEANGLEUNIT.,$,.RADIAN.) or the conversion based unit DEGREE",
};
/// Times (s).
pub const TIME: Quantity = Quantity {
    name: "time",
    unit_type: "TIMEUNIT",
    measures: &["IFCTIMEMEASURE"],
    dimensions: [0, 0, 1, 0, 0, 0, 0],
    remedy: "IFCSIUNIT(*,.TIMEUNIT.,$,.SECOND.)",
};
/// Speeds (m/s).
pub const VELOCITY: Quantity = Quantity {
    name: "linear velocity",
    unit_type: "LINEARVELOCITYUNIT",
    measures: &["IFCLINEARVELOCITYMEASURE"],
    dimensions: [1, 0, -1, 0, 0, 0, 0],
    remedy: "an IfcDerivedUnit LINEARVELOCITYUNIT, or a Unit to the property,",
};
/// Accelerations (m/s²).
pub const ACCELERATION: Quantity = Quantity {
    name: "acceleration",
    unit_type: "ACCELERATIONUNIT",
    measures: &["IFCACCELERATIONMEASURE"],
    dimensions: [1, 0, -2, 0, 0, 0, 0],
    remedy: "an IfcDerivedUnit ACCELERATIONUNIT, or a Unit to the property,",
};
/// Volume flows (m³/s).
pub const FLOW: Quantity = Quantity {
    name: "volume flow",
    unit_type: "VOLUMETRICFLOWRATEUNIT",
    measures: &["IFCVOLUMETRICFLOWRATEMEASURE"],
    dimensions: [3, 0, -1, 0, 0, 0, 0],
    remedy: "an IfcDerivedUnit VOLUMETRICFLOWRATEUNIT, or a Unit to the property,",
};

/// A unit: one of it is `factor` of the SI unit.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Unit {
    factor: f64,
    dimensions: Dimensions,
}

/// The project's units.
#[derive(Debug)]
pub struct Units<'f> {
    /// Metres in one length unit.
    pub length: f64,
    /// Radians in one plane angle unit.
    pub angle: f64,
    assignment: Record<'f>,
    /// Numbers of the units assigned, by unit type.
    assigned: BTreeMap<&'f str, Vec<u64>>,
}

impl<'f> Units<'f> {
    /// Reads the project's unit assignment. Length and angle must be there; the others are looked up when needed.
    pub fn read(file: &'f File<'f>) -> Result<Self, ModelError> {
        let project = project(file)?;
        let assignment = project.follow_if_given(8, "UnitsInContext")?;
        let assignment = assignment.ok_or_else(|| missing(project.entity(), &LENGTH, "the geometry"))?;
        let mut assigned: BTreeMap<_, Vec<u64>> = BTreeMap::new();
        for id in assignment.references(0, "Units")? {
            let unit = assignment.open(id)?;
            // Money has no unit type, and nothing here needs it.
            if unit.keyword != "IFCMONETARYUNIT" {
                assigned.entry(unit.enumeration(1, "UnitType")?).or_default().push(id);
            }
        }
        let mut units = Self { length: 1.0, angle: 1.0, assignment, assigned };
        units.length = units.factor(&LENGTH, "the geometry")?;
        units.angle = units.factor(&ANGLE, "the geometry")?;
        Ok(units)
    }

    /// SI units in one of the project's units of this quantity.
    pub fn factor(&self, quantity: &Quantity, needed_for: &str) -> Result<f64, ModelError> {
        match self.assigned.get(quantity.unit_type).map(Vec::as_slice) {
            Some([id]) => factor_of(&self.assignment.open(*id)?, quantity),
            Some([first, second, ..]) => {
                let found = format!("#{first} and #{second}");
                Err(self.assignment.wrong("Units", format!("one {}", quantity.unit_type), found))
            }
            _ => Err(missing(self.assignment.entity(), quantity, needed_for)),
        }
    }

    /// A property's or quantity's value in SI: `value` names its type as IFC requires, `unit` overrides the project's.
    pub fn value(
        &self,
        owner: &Record<'f>,
        value: &Value<'f>,
        unit: Option<&Record<'f>>,
        quantity: &Quantity,
        needed_for: &str,
    ) -> Result<f64, ModelError> {
        let expected = || format!("a {} ({})", quantity.name, quantity.measures.join(" or "));
        let Value::Typed(measure, values) = value else {
            return Err(owner.wrong_value("NominalValue", &expected(), value));
        };
        let [number] = values.as_slice() else {
            return Err(owner.wrong_value("NominalValue", &expected(), value));
        };
        let number = owner.as_real(number, "NominalValue")?;
        let bare = ["IFCREAL", "IFCINTEGER", "IFCNUMERICMEASURE"].contains(measure);
        let factor = match unit {
            Some(unit) if bare || quantity.measures.contains(measure) => factor_of(unit, quantity)?,
            None if quantity.measures.contains(measure) => self.factor(quantity, needed_for)?,
            None if bare => {
                return Err(owner.wrong(
                    "Unit",
                    format!("a unit of {}, or the value as {}", quantity.name, expected()),
                    "neither",
                ));
            }
            _ => return Err(owner.wrong("NominalValue", expected(), describe(value))),
        };
        Ok(number * factor)
    }
}

fn missing(entity: Box<Entity>, quantity: &Quantity, needed_for: &str) -> ModelError {
    ModelError::MissingUnit {
        entity,
        unit: quantity.unit_type,
        needed_for: needed_for.to_owned(),
        remedy: quantity.remedy,
    }
}

/// SI units in one of `record`, which must measure `quantity`.
pub fn factor_of(record: &Record<'_>, quantity: &Quantity) -> Result<f64, ModelError> {
    let unit = resolve(record, 0)?;
    if unit.dimensions != quantity.dimensions {
        let found = format!("{:?} (exponents of m, g, s, A, K, mol, cd)", unit.dimensions);
        let expected = format!("{} ({:?})", quantity.name, quantity.dimensions);
        return Err(ModelError::WrongUnit { entity: record.entity(), expected, found });
    }
    Ok(unit.factor)
}

fn resolve(record: &Record<'_>, depth: usize) -> Result<Unit, ModelError> {
    if depth >= DEPTH_MAX {
        return Err(ModelError::TooDeep { entity: record.entity(), limit: DEPTH_MAX });
    }
    let unit = match record.keyword {
        "IFCSIUNIT" => si(record)?,
        "IFCCONVERSIONBASEDUNIT" => {
            let measure = record.follow(3, "ConversionFactor")?;
            let value = match measure.value(0, "ValueComponent")? {
                Value::Typed(_, values) if values.len() == 1 => measure.as_real(&values[0], "ValueComponent")?,
                other => measure.as_real(other, "ValueComponent")?,
            };
            let base = resolve(&measure.follow(1, "UnitComponent")?, depth + 1)?;
            Unit { factor: value * base.factor, ..base }
        }
        "IFCDERIVEDUNIT" => derived(record, depth)?,
        _ => return Err(unsupported(record)),
    };
    if unit.factor > 0.0 && unit.factor.is_finite() {
        Ok(unit)
    } else {
        Err(record.wrong("ConversionFactor", "a unit of positive, finite size", unit.factor.to_string()))
    }
}

fn derived(record: &Record<'_>, depth: usize) -> Result<Unit, ModelError> {
    let mut product = Unit { factor: 1.0, dimensions: [0; 7] };
    let elements = record.references(0, "Elements")?;
    if elements.len() > ELEMENTS_MAX {
        return Err(record.wrong("Elements", format!("at most {ELEMENTS_MAX}"), elements.len().to_string()));
    }
    for id in elements {
        let element = record.open(id)?;
        let exponent = match element.value(1, "Exponent")? {
            // No physical quantity has higher powers; a bound keeps the sums below from overflowing.
            Value::Integer(exponent @ -9..=9) => *exponent as i32,
            other => return Err(element.wrong_value("Exponent", "a whole number from -9 to 9", other)),
        };
        let unit = resolve(&element.follow(0, "Unit")?, depth + 1)?;
        product.factor *= unit.factor.powi(exponent);
        for (sum, of_element) in product.dimensions.iter_mut().zip(unit.dimensions) {
            *sum = sum.saturating_add(of_element.saturating_mul(exponent));
        }
    }
    Ok(product)
}

fn si(record: &Record<'_>) -> Result<Unit, ModelError> {
    let prefix = match record.given(2, "Prefix")? {
        None => 1.0,
        Some(Value::Enum(name)) => prefix(name).ok_or_else(|| record.wrong("Prefix", "an SI prefix", *name))?,
        Some(other) => return Err(record.wrong_value("Prefix", "an SI prefix", other)),
    };
    let (power, dimensions) = match record.enumeration(3, "Name")? {
        "METRE" => (1, [1, 0, 0, 0, 0, 0, 0]),
        "SQUARE_METRE" => (2, [2, 0, 0, 0, 0, 0, 0]),
        "CUBIC_METRE" => (3, [3, 0, 0, 0, 0, 0, 0]),
        "GRAM" => (1, [0, 1, 0, 0, 0, 0, 0]),
        "SECOND" => (1, [0, 0, 1, 0, 0, 0, 0]),
        "HERTZ" => (1, [0, 0, -1, 0, 0, 0, 0]),
        "RADIAN" => (1, [0; 7]),
        _ => return Err(unsupported(record)),
    };
    // A prefix belongs to the metre, not to its square or cube: mm² is (0.001 m)².
    Ok(Unit { factor: f64::powi(prefix, power), dimensions })
}

fn unsupported(record: &Record<'_>) -> ModelError {
    ModelError::Unsupported {
        entity: record.entity(),
        what: "unit",
        of: String::new(),
        instead: "IfcSIUnit of metre, second, hertz, gram or radian, or as IfcConversionBasedUnit or IfcDerivedUnit of these",
    }
}

fn prefix(name: &str) -> Option<f64> {
    Some(match name {
        "EXA" => 1e18,
        "PETA" => 1e15,
        "TERA" => 1e12,
        "GIGA" => 1e9,
        "MEGA" => 1e6,
        "KILO" => 1e3,
        "HECTO" => 1e2,
        "DECA" => 1e1,
        "DECI" => 1e-1,
        "CENTI" => 1e-2,
        "MILLI" => 1e-3,
        "MICRO" => 1e-6,
        "NANO" => 1e-9,
        "PICO" => 1e-12,
        "FEMTO" => 1e-15,
        "ATTO" => 1e-18,
        _ => return None,
    })
}
