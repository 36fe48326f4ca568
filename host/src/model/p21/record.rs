//! An entity with its attributes parsed, and typed access to them. Attributes are addressed by position, as in the file,
//! and named as in the schema for messages.

use super::{File, Instance, Value, text};
use crate::model::error::{Entity, ModelError};

/// One entity of one type, attributes parsed.
#[derive(Debug)]
pub struct Record<'f> {
    pub(super) file: &'f File<'f>,
    pub(super) instance: &'f Instance,
    /// The type's name, in capitals.
    pub keyword: &'f str,
    /// Its attributes in the order of the schema.
    pub attributes: Vec<Value<'f>>,
}

impl<'f> Record<'f> {
    /// The number behind the `#`.
    pub fn id(&self) -> u64 {
        self.instance.id
    }

    /// The file it belongs to.
    pub fn file(&self) -> &'f File<'f> {
        self.file
    }

    /// The entity as a message names it.
    pub fn entity(&self) -> Box<Entity> {
        Box::new(self.file.name_of(self.instance))
    }

    /// The attribute, or an error when the entity has too few; `$` and `*` are values like others here.
    pub fn value(&self, index: usize, attribute: &'static str) -> Result<&Value<'f>, ModelError> {
        let count = self.attributes.len();
        self.attributes.get(index).ok_or_else(|| {
            let expected = format!("at least {} attributes", index + 1);
            self.wrong(attribute, expected, format!("{count} attributes"))
        })
    }

    /// The attribute unless it is `$`.
    pub fn given(&self, index: usize, attribute: &'static str) -> Result<Option<&Value<'f>>, ModelError> {
        let value = self.value(index, attribute)?;
        Ok(if *value == Value::Null { None } else { Some(value) })
    }

    /// The number of the entity referred to.
    pub fn reference(&self, index: usize, attribute: &'static str) -> Result<u64, ModelError> {
        self.as_reference(self.value(index, attribute)?, attribute)
    }

    /// The number of the entity referred to, unless `$`.
    pub fn reference_if_given(&self, index: usize, attribute: &'static str) -> Result<Option<u64>, ModelError> {
        self.given(index, attribute)?.map(|value| self.as_reference(value, attribute)).transpose()
    }

    /// The entity referred to, parsed.
    pub fn follow(&self, index: usize, attribute: &'static str) -> Result<Record<'f>, ModelError> {
        self.open(self.reference(index, attribute)?)
    }

    /// The entity referred to, parsed, unless `$`.
    pub fn follow_if_given(&self, index: usize, attribute: &'static str) -> Result<Option<Record<'f>>, ModelError> {
        self.reference_if_given(index, attribute)?.map(|id| self.open(id)).transpose()
    }

    /// Parses the entity `target` that this one refers to.
    pub fn open(&self, target: u64) -> Result<Record<'f>, ModelError> {
        match self.file.get(target) {
            Some(instance) => self.file.record_of(instance),
            None => Err(ModelError::Dangling { entity: self.entity(), target }),
        }
    }

    /// A list.
    pub fn list(&self, index: usize, attribute: &'static str) -> Result<&[Value<'f>], ModelError> {
        match self.value(index, attribute)? {
            Value::List(values) => Ok(values),
            other => Err(self.wrong_value(attribute, "a list", other)),
        }
    }

    /// A list of references.
    pub fn references(&self, index: usize, attribute: &'static str) -> Result<Vec<u64>, ModelError> {
        self.list(index, attribute)?.iter().map(|value| self.as_reference(value, attribute)).collect()
    }

    /// A list of numbers.
    pub fn reals(&self, index: usize, attribute: &'static str) -> Result<Vec<f64>, ModelError> {
        self.list(index, attribute)?.iter().map(|value| self.as_real(value, attribute)).collect()
    }

    /// A list of whole numbers, none negative.
    pub fn counts(&self, index: usize, attribute: &'static str) -> Result<Vec<usize>, ModelError> {
        self.list(index, attribute)?.iter().map(|value| self.as_count(value, attribute)).collect()
    }

    /// A number.
    pub fn real(&self, index: usize, attribute: &'static str) -> Result<f64, ModelError> {
        self.as_real(self.value(index, attribute)?, attribute)
    }

    /// A whole number, not negative.
    pub fn count(&self, index: usize, attribute: &'static str) -> Result<usize, ModelError> {
        self.as_count(self.value(index, attribute)?, attribute)
    }

    /// `.T.` or `.F.`.
    pub fn flag(&self, index: usize, attribute: &'static str) -> Result<bool, ModelError> {
        match self.value(index, attribute)? {
            Value::Enum("T") => Ok(true),
            Value::Enum("F") => Ok(false),
            other => Err(self.wrong_value(attribute, ".T. or .F.", other)),
        }
    }

    /// An enumeration value without its dots.
    pub fn enumeration(&self, index: usize, attribute: &'static str) -> Result<&'f str, ModelError> {
        match self.value(index, attribute)? {
            Value::Enum(name) => Ok(name),
            other => Err(self.wrong_value(attribute, "an enumeration value", other)),
        }
    }

    /// A string, decoded.
    pub fn text(&self, index: usize, attribute: &'static str) -> Result<String, ModelError> {
        self.decode(self.value(index, attribute)?, attribute)
    }

    /// A string, decoded, unless `$`.
    pub fn text_if_given(&self, index: usize, attribute: &'static str) -> Result<Option<String>, ModelError> {
        self.given(index, attribute)?.map(|value| self.decode(value, attribute)).transpose()
    }

    /// Decodes a string value, also one that names its type: `IFCLABEL('…')`.
    pub fn decode(&self, value: &Value<'f>, attribute: &'static str) -> Result<String, ModelError> {
        match value {
            Value::Text(raw) => {
                text::decode(raw).map_err(|found| self.wrong(attribute, "a string as ISO 10303-21 encodes it", found))
            }
            Value::Typed(_, values) => match values.as_slice() {
                [Value::Text(_)] => self.decode(&values[0], attribute),
                _ => Err(self.wrong_value(attribute, "a string", value)),
            },
            other => Err(self.wrong_value(attribute, "a string", other)),
        }
    }

    /// A value as a reference.
    pub fn as_reference(&self, value: &Value<'f>, attribute: &'static str) -> Result<u64, ModelError> {
        match value {
            Value::Ref(id) => Ok(*id),
            other => Err(self.wrong_value(attribute, "a reference to an entity", other)),
        }
    }

    /// A value as a number; real files write whole numbers where reals belong.
    pub fn as_real(&self, value: &Value<'f>, attribute: &'static str) -> Result<f64, ModelError> {
        match value {
            Value::Real(number) => Ok(*number),
            Value::Integer(number) => Ok(*number as f64),
            other => Err(self.wrong_value(attribute, "a number", other)),
        }
    }

    /// A value as a whole number, not negative.
    pub fn as_count(&self, value: &Value<'f>, attribute: &'static str) -> Result<usize, ModelError> {
        match value {
            Value::Integer(number) if usize::try_from(*number).is_ok() => Ok(*number as usize),
            other => Err(self.wrong_value(attribute, "a whole number, not negative", other)),
        }
    }

    /// The error "attribute: expected …, found …".
    pub fn wrong(&self, attribute: &'static str, expected: impl Into<String>, found: impl Into<String>) -> ModelError {
        ModelError::Attribute { entity: self.entity(), attribute, expected: expected.into(), found: found.into() }
    }

    /// The same, showing the value found.
    pub fn wrong_value(&self, attribute: &'static str, expected: &str, found: &Value<'_>) -> ModelError {
        self.wrong(attribute, expected, describe(found))
    }

    /// The error "impossible geometry".
    pub fn impossible(&self, problem: impl Into<String>) -> ModelError {
        ModelError::Geometry { entity: self.entity(), problem: problem.into() }
    }
}

/// A value as a message shows it.
pub fn describe(value: &Value<'_>) -> String {
    match value {
        Value::Null => "nothing ($)".to_owned(),
        Value::Derived => "a derived value (*)".to_owned(),
        Value::Integer(number) => number.to_string(),
        Value::Real(number) => number.to_string(),
        Value::Text(raw) => format!("the string '{}'", String::from_utf8_lossy(raw)),
        Value::Enum(name) => format!(".{name}."),
        Value::Binary(digits) => format!("binary \"{digits}\""),
        Value::Ref(id) => format!("#{id}"),
        Value::List(values) => format!("a list of {}", values.len()),
        Value::Typed(name, values) => {
            format!("{name}({})", values.iter().map(describe).collect::<Vec<_>>().join(", "))
        }
    }
}
