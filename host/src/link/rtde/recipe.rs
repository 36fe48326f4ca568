//! What a client and a controller tell each other: the fields of each recipe, and Screed's own in every cycle.

use super::error::LinkError;
use super::fields;
use super::file::{Recipe, RecipeFile};
use super::wire::{FieldType, HEADER_LEN, PackageKind, PackageWriter, PayloadReader, ShortText};
use screed_kernel::units::{JointPos, JointVel};
use std::fmt;

/// A field's name; the guide's longest has 39 bytes.
pub type FieldName = ShortText<48>;

/// A field of a recipe.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Field {
    /// Its name.
    pub name: FieldName,
    /// Its type by the guide; by the recipe file where the guide has no such field.
    pub kind: FieldType,
    /// The line of the recipe file; 0 for what Screed asks for itself.
    pub line: u32,
}

impl Field {
    fn own(name: &str, kind: FieldType) -> Self {
        Self { name: FieldName::cut(name.as_bytes()), kind, line: 0 }
    }

    /// Whether it is the controller's time.
    pub fn is_timestamp(&self) -> bool {
        self.name.as_bytes() == OUTPUTS[0].as_bytes()
    }
}

/// A number in a data package.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Value {
    /// Of `BOOL`.
    Bool(bool),
    /// Of the types without a sign.
    Unsigned(u64),
    /// Of those with one.
    Signed(i32),
    /// Of those with a fraction.
    Double(f64),
}

impl fmt::Display for Value {
    /// As Rust reads it again without loss.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Bool(value) => write!(f, "{}", u8::from(*value)),
            Self::Unsigned(value) => write!(f, "{value}"),
            Self::Signed(value) => write!(f, "{value}"),
            Self::Double(value) => write!(f, "{value}"),
        }
    }
}

/// The values of fields, one after the other as they stand in a data package, each with its numbers.
pub fn values<'a>(
    fields: &'a [Field],
    bytes: &'a [u8],
) -> impl Iterator<Item = (&'a Field, impl Iterator<Item = Value> + 'a)> + 'a {
    fields.iter().scan(PayloadReader::new(bytes), |reader, field| {
        let bytes = reader.bytes(field.kind.size())?;
        let numbers = bytes.chunks(field.kind.size() / field.kind.elements());
        Some((field, numbers.filter_map(|number| value(field.kind, number))))
    })
}

fn value(kind: FieldType, bytes: &[u8]) -> Option<Value> {
    let mut reader = PayloadReader::new(bytes);
    match kind {
        FieldType::Bool => reader.u8().map(|byte| Value::Bool(byte != 0)),
        FieldType::Uint8 => reader.u8().map(|value| Value::Unsigned(value.into())),
        FieldType::Uint32 | FieldType::Vector6Uint32 => reader.u32().map(|value| Value::Unsigned(value.into())),
        FieldType::Uint64 => reader.u64().map(Value::Unsigned),
        FieldType::Int32 | FieldType::Vector6Int32 => reader.i32().map(Value::Signed),
        FieldType::Double | FieldType::Vector3d | FieldType::Vector6d => reader.f64().map(Value::Double),
    }
}

/// What is agreed on with a controller: one recipe each way. Made before the connection, and the same for each one.
///
/// All inputs are in one recipe, however a file groups them: a package can then not be there by half, and there are servers
/// that keep only the latest recipe of inputs.
#[derive(Clone, Debug, PartialEq)]
pub struct Recipes {
    /// In the order in which they are asked for.
    pub outputs: Vec<Field>,
    /// In the order in which they are written.
    pub inputs: Vec<Field>,
    /// Where the fields that have a line stand.
    pub file: Option<RecipeFile>,
    /// Bytes of the outputs' values.
    pub(super) size: u16,
    /// Room for any package but texts.
    pub(super) longest: u16,
}

/// The outputs that Screed needs; those of its registers follow.
const OUTPUTS: [&str; 7] =
    ["timestamp", "actual_q", "actual_qd", "target_q", "actual_TCP_pose", "runtime_state", "robot_mode"];
/// Last of all: what a package that lost its end shows here, the next one's header, is mostly no set of bits.
const LAST_OUTPUT: &str = "safety_status_bits";

impl Recipes {
    /// Screed's own, and beside them the outputs that a file names.
    ///
    /// # Errors
    /// [`LinkError::RecipeTooLong`].
    pub fn screed(register_offset: u8, file: Option<&RecipeFile>) -> Result<Self, LinkError> {
        let n = register_offset;
        let output = |name: &str| fields::output(name).map(|kind| Field::own(name, kind));
        let input = |name: String| fields::input(&name).map(|kind| Field::own(&name, kind));
        let registers = [format!("output_int_register_{n}"), format!("input_int_register_{n}")];
        let mut outputs: Vec<_> =
            OUTPUTS.into_iter().chain(registers.iter().map(String::as_str)).filter_map(output).collect();
        for field in file.into_iter().flat_map(RecipeFile::outputs) {
            if field.name.as_bytes() != LAST_OUTPUT.as_bytes() && !outputs.iter().any(|known| known.name == field.name)
            {
                outputs.push(*field);
            }
        }
        outputs.extend(output(LAST_OUTPUT));
        let doubles = (n..n + 6).map(|register| format!("input_double_register_{register}"));
        let inputs = doubles.chain([format!("input_int_register_{n}")]).filter_map(input).collect();
        Self { outputs, inputs, file: file.cloned(), size: 0, longest: 0 }.sized()
    }

    /// The outputs of one recipe of a file, and no inputs: for who only reads. Without a time stamp in it, one is asked for
    /// behind them.
    ///
    /// # Errors
    /// [`LinkError::RecipeTooLong`].
    pub fn reading(recipe: &Recipe, file: &RecipeFile) -> Result<Self, LinkError> {
        let mut outputs = recipe.fields.clone();
        if !outputs.iter().any(Field::is_timestamp) {
            outputs.push(Field::own(OUTPUTS[0], FieldType::Double));
        }
        Self { outputs, inputs: Vec::new(), file: Some(file.clone()), size: 0, longest: 0 }.sized()
    }

    /// Outputs by their names, all of the guide's table, and no inputs: for who only reads. What is not in the table is left out.
    ///
    /// # Errors
    /// [`LinkError::RecipeTooLong`].
    pub fn of(names: &[&str]) -> Result<Self, LinkError> {
        let outputs = names.iter().filter_map(|name| Some(Field::own(name, fields::output(name)?))).collect();
        Self { outputs, inputs: Vec::new(), file: None, size: 0, longest: 0 }.sized()
    }

    fn sized(mut self) -> Result<Self, LinkError> {
        let size: usize = self.outputs.iter().map(|field| field.kind.size()).sum();
        // A type's name is shorter than 16 bytes, and so is a refusal.
        let list = |fields: &[Field]| fields.iter().map(|field| field.name.as_bytes().len().max(15) + 1).sum::<usize>();
        let longest = HEADER_LEN + size_of::<f64>() + list(&self.outputs).max(list(&self.inputs)).max(size);
        match (u16::try_from(size), u16::try_from(longest)) {
            (Ok(size), Ok(longest)) => (self.size, self.longest) = (size, longest),
            _ => return Err(LinkError::RecipeTooLong { fields: self.outputs.len(), size: longest }),
        }
        Ok(self)
    }

    /// The outputs that a file wants beside Screed's own.
    pub(super) fn extra(&self) -> &[Field] {
        self.outputs.get(OUTPUTS.len() + 2..self.outputs.len() - 1).unwrap_or(&[])
    }
}

/// Bytes of a package of Screed's inputs: header, recipe id, values.
pub const INPUT_PACKAGE_SIZE: usize = 3 + 1 + 6 * 8 + 4;

/// What the robot says of itself in one cycle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RobotState {
    /// Time since the controller was started (s).
    pub timestamp: f64,
    /// Where the joints are, by their encoders (rad).
    pub actual_q: JointPos<6>,
    /// How fast they turn (rad/s).
    pub actual_qd: JointVel<6>,
    /// Where the controller wants them in this cycle (rad).
    pub target_q: JointPos<6>,
    /// base_from_tcp as the controller computes it: x, y, z (m) and rotation vector (rad).
    pub actual_tcp_pose: [f64; 6],
    /// 0 stopping, 1 stopped, 2 playing, 3 pausing, 4 paused, 5 resuming.
    pub runtime_state: u32,
    /// −1 no controller, 0 disconnected, 1 confirm safety, 2 booting, 3 power off, 4 power on, 5 idle, 6 backdrive, 7 running,
    /// 8 updating firmware.
    pub robot_mode: i32,
    /// Bits: 0 normal, 1 reduced, 2 protective stop, 3 recovery, 4 safeguard stop, 5 system emergency stop, 6 robot emergency
    /// stop, 7 emergency stop, 8 violation, 9 fault, 10 stopped due to safety, 11 three-position enabling stop.
    pub safety_status_bits: u32,
    /// What the robot program says in its output register, see [`super::program::ProgramState`].
    pub program_state: i32,
    /// Sequence number of the setpoint that had arrived when this state was made.
    pub arrived: i32,
}

impl RobotState {
    /// Decodes the values of a package, and gives those that a file wanted beside them; None when the length is wrong.
    pub(super) fn decode(values: &[u8]) -> Option<(Self, &[u8])> {
        let (values, last) = values.split_last_chunk()?;
        let mut reader = PayloadReader::new(values);
        let state = Self {
            timestamp: reader.f64()?,
            actual_q: JointPos(reader.f64s()?),
            actual_qd: JointVel(reader.f64s()?),
            target_q: JointPos(reader.f64s()?),
            actual_tcp_pose: reader.f64s()?,
            runtime_state: reader.u32()?,
            robot_mode: reader.i32()?,
            program_state: reader.i32()?,
            arrived: reader.i32()?,
            safety_status_bits: u32::from_be_bytes(*last),
        };
        Some((state, reader.rest()))
    }
}

/// Encodes one setpoint; None when `out` is too small.
pub(super) fn encode_setpoint(out: &mut [u8], recipe: u8, seq: u32, joints: &JointPos<6>) -> Option<usize> {
    let mut writer = PackageWriter::new(out, PackageKind::Data);
    writer.u8(recipe).f64s(&joints.0).bytes(&seq.to_be_bytes());
    writer.finish()
}
