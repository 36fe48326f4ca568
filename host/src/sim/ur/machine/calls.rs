//! The functions of the controller.

use super::compute::{boolean, index, number, wrong};
use super::{Notice, Surroundings, Waiting, WatchdogRequest};
use crate::link::rtde::fields::REGISTERS;
use crate::link::rtde::program::{GAIN_RANGE, LOOKAHEAD_RANGE, WatchdogAction};
use crate::sim::ur::body::{Goal, Motion};
use crate::sim::ur::messages::Popup;
use crate::sim::ur::numbers;
use crate::sim::ur::script::ScriptError;
use crate::sim::ur::script::builtins::Builtin;
use crate::sim::ur::script::code::Value;
use crate::sim::ur::servo::ServoCommand;
use nalgebra::Vector3;
use screed_kernel::pose::Pose;
use screed_kernel::units::JointPos;

const REGISTER: &str = "register 0 to 47";
const BIT_REGISTER: &str = "register 0 to 127";
/// Longest `sleep` and `servoj` (s).
const TIME_MAX: f64 = 86_400.0;
const IN_RANGE: &str = "number within the range of the URScript manual";
/// Defaults of the URScript manual.
const MOVEJ_DEFAULTS: [f64; 2] = [1.4, 1.05];
const MOVEL_DEFAULTS: [f64; 2] = [1.2, 0.25];
const SPEEDJ_DEFAULT: f64 = 1.4;

type Outcome = Result<(Value, Option<Waiting>), ScriptError>;

/// One call in progress.
pub(super) struct Call<'a, 'b> {
    pub line: usize,
    pub thread: u32,
    pub arguments: &'a [Value],
    /// For each parameter its argument.
    pub places: &'a [Option<usize>],
    pub around: &'a mut Surroundings<'b>,
}

impl Call<'_, '_> {
    /// What it gives, and what the thread then waits for.
    pub(super) fn run(&mut self, builtin: Builtin) -> Outcome {
        match builtin {
            Builtin::Servoj => self.servoj(),
            Builtin::Movej => self.move_to(false),
            Builtin::Movel => self.move_to(true),
            Builtin::Speedj => self.speed(false),
            Builtin::Speedl => self.speed(true),
            Builtin::Stopj => self.stop(false),
            Builtin::Stopl => self.stop(true),
            Builtin::Sync => Ok((Value::Nothing, Some(Waiting::Until(self.around.cycle + 1)))),
            Builtin::Sleep => {
                let time = self.number_in(0, [0.0, TIME_MAX])?;
                Ok((Value::Nothing, Some(Waiting::Until(self.cycle_after(time)))))
            }
            Builtin::Popup => {
                let text = |place| self.value(place).map(ToString::to_string);
                let (text, title) = (text(0).unwrap_or_default(), text(1).unwrap_or_else(|| "Popup".to_owned()));
                let flag = |place| self.value(place).map_or(Ok(false), |value| boolean(self.line, value));
                let (warning, error, blocking) = (flag(2)?, flag(3)?, flag(4)?);
                self.around.notices.push(Notice::Popup(Popup { text, title, warning, error, blocking }));
                Ok((Value::Nothing, blocking.then_some(Waiting::Until(self.around.cycle + 1))))
            }
            Builtin::ProtectiveStop => {
                self.around.notices.push(Notice::ProtectiveStop);
                Ok((Value::Nothing, Some(Waiting::Until(self.around.cycle + 1))))
            }
            _ => self.compute(builtin).map(|value| (value, None)),
        }
    }

    fn compute(&mut self, builtin: Builtin) -> Result<Value, ScriptError> {
        if let Some(function) = builtin.of_number() {
            return Ok(Value::Number(function(self.number(0)?)));
        }
        Ok(match builtin {
            Builtin::ReadInputFloat => Value::Number(self.around.inputs.double(self.register(0)?)),
            Builtin::ReadInputInteger => Value::Number(f64::from(self.around.inputs.int(self.register(0)?))),
            Builtin::ReadInputBoolean => Value::Boolean(self.around.inputs.bit(self.bit(0)?)),
            Builtin::ReadOutputFloat => Value::Number(self.around.outputs.double(self.register(0)?)),
            Builtin::ReadOutputInteger => Value::Number(f64::from(self.around.outputs.int(self.register(0)?))),
            Builtin::ReadOutputBoolean => Value::Boolean(self.around.outputs.bit(self.bit(0)?)),
            Builtin::WriteOutputFloat => {
                let (register, value) = (self.register(0)?, self.number(1)?);
                self.done(|around| around.outputs.set_double(register, value))
            }
            Builtin::WriteOutputInteger => {
                let register = self.register(0)?;
                let value = self.number_in(1, [f64::from(i32::MIN), f64::from(i32::MAX)])?;
                self.done(|around| around.outputs.set_int(register, value as i32))
            }
            Builtin::WriteOutputBoolean => {
                let (register, value) = (self.bit(0)?, self.boolean(1)?);
                self.done(|around| around.outputs.set_bit(register, value))
            }
            Builtin::SetWatchdog => self.set_watchdog()?,
            Builtin::TextMessage => {
                let text: String = (0..2).filter_map(|place| self.value(place)).map(ToString::to_string).collect();
                self.done(|around| around.notices.push(Notice::Text(text)))
            }
            // Kept by no one: force mode is not simulated.
            Builtin::ForceModeParameter => {
                self.number(0)?;
                Value::Nothing
            }
            Builtin::SetDigitalOut => self.set_digital(0, 8)?,
            Builtin::SetConfigurableOut => self.set_digital(1, 8)?,
            Builtin::SetToolOut => self.set_digital(2, 2)?,
            Builtin::StandardDigitalIn => self.digital_input(0, 8)?,
            Builtin::ConfigurableDigitalIn => self.digital_input(8, 8)?,
            Builtin::ToolDigitalIn => self.digital_input(16, 2)?,
            Builtin::StandardAnalogIn => self.analog_input(0)?,
            Builtin::ToolAnalogIn => self.analog_input(2)?,
            Builtin::Atan2 => Value::Number(self.number(0)?.atan2(self.number(1)?)),
            Builtin::Pow => Value::Number(self.number(0)?.powf(self.number(1)?)),
            Builtin::Norm => match self.argument(0)? {
                Value::List(values) => Value::Number(values.iter().map(|value| value * value).sum::<f64>().sqrt()),
                Value::Pose(values) => Value::Number(values.iter().map(|value| value * value).sum::<f64>().sqrt()),
                Value::Number(value) => Value::Number(value.abs()),
                other => return Err(wrong(self.line, "list", other)),
            },
            Builtin::Length => match self.argument(0)? {
                Value::List(values) => Value::Number(values.len() as f64),
                Value::Pose(_) => Value::Number(6.0),
                other => return Err(wrong(self.line, "list", other)),
            },
            Builtin::PoseTrans => pose_value(&(self.pose(0)? * self.pose(1)?)),
            Builtin::PoseAdd => {
                let (first, second) = (self.pose(0)?, self.pose(1)?);
                pose_value(&add(&first, &second))
            }
            Builtin::PoseSub => {
                let (first, second) = (self.pose(0)?, self.pose(1)?);
                let rotation = first.rotation * second.rotation.transpose();
                pose_value(&Pose { rotation, translation: first.translation - second.translation })
            }
            Builtin::PoseInv => pose_value(&self.pose(0)?.inverse()),
            _ => return self.of_robot(builtin),
        })
    }

    /// What the arm is asked, and set.
    fn of_robot(&mut self, builtin: Builtin) -> Result<Value, ScriptError> {
        let body = &self.around.body;
        Ok(match builtin {
            Builtin::ActualJoints => Value::List(body.servo.q.0.to_vec()),
            Builtin::JointSpeeds => Value::List(body.servo.qd.0.to_vec()),
            Builtin::JointsBefore => {
                let steps = self.value(0).map_or(Ok(0.0), |value| number(self.line, value))?;
                let found = body.joints_before(steps.max(0.0) as usize);
                Value::List(found.ok_or_else(|| wrong(self.line, IN_RANGE, &Value::Number(steps)))?.to_vec())
            }
            Builtin::TcpPose => pose_value(&body.base_from_tcp()),
            Builtin::TcpSpeed => Value::List(body.tool_speed().to_vec()),
            Builtin::FlangePose => pose_value(&body.arm.forward(&body.servo.q)),
            Builtin::TcpOffset => pose_value(&body.flange_from_tcp),
            Builtin::SetTcp => {
                let pose = self.pose(0)?;
                self.done(|around| around.body.flange_from_tcp = pose)
            }
            Builtin::SetPayload | Builtin::SetTargetPayload => {
                self.set_payload(builtin == Builtin::SetTargetPayload)?
            }
            Builtin::Payload => Value::Number(body.payload.mass),
            Builtin::PayloadCog => Value::List(body.payload.centre.to_vec()),
            Builtin::PayloadInertia => Value::List(body.payload.inertia.to_vec()),
            Builtin::SetGravity => {
                let gravity = self.list(0)?;
                self.done(|around| around.body.gravity = gravity)
            }
            Builtin::StepTime => Value::Number(1.0 / self.around.cycles_per_second),
            Builtin::IsSteady => Value::Boolean(body.is_steady()),
            Builtin::ForwardKin => {
                let joints = self.value(0).map_or(Ok(body.servo.q.0), |_| self.list(0))?;
                let tool = self.value(1).map_or(Ok(body.flange_from_tcp), |_| self.pose(1))?;
                pose_value(&(body.arm.forward(&JointPos(joints)) * tool))
            }
            Builtin::InverseKin => {
                let pose = self.argument(0)?;
                let found = self.inverse()?.ok_or_else(|| wrong(self.line, "pose that the arm reaches", pose))?;
                Value::List(found.to_vec())
            }
            Builtin::HasInverseKin => Value::Boolean(self.inverse()?.is_some()),
            Builtin::WithinSafetyLimits => Value::Boolean(match self.argument(0)? {
                Value::List(_) => self.is_within_range(&self.list(0)?),
                _ => {
                    let pose = self.pose(0)?;
                    body.inverse(&pose, &body.servo.q).is_ok()
                }
            }),
            Builtin::TargetWaypoint => match body.waypoint() {
                Some(Goal::Tool(pose)) => pose_value(&pose),
                Some(Goal::Joints(joints)) => pose_value(&(body.arm.forward(&JointPos(joints)) * body.flange_from_tcp)),
                None => pose_value(&body.base_from_tcp()),
            },
            // The model has no forces, and the arm touches nothing.
            Builtin::JointTorques => Value::List(vec![0.0; 6]),
            Builtin::ToolContact => Value::Number(0.0),
            _ => return Err(wrong(self.line, "another function", &Value::Nothing)),
        })
    }

    fn value(&self, parameter: usize) -> Option<&Value> {
        self.arguments.get(self.places.get(parameter).copied().flatten()?)
    }

    fn argument(&self, parameter: usize) -> Result<&Value, ScriptError> {
        // The parser has seen that it is there.
        self.value(parameter).ok_or_else(|| wrong(self.line, "argument", &Value::Nothing))
    }

    fn number(&self, parameter: usize) -> Result<f64, ScriptError> {
        number(self.line, self.argument(parameter)?)
    }

    fn boolean(&self, parameter: usize) -> Result<bool, ScriptError> {
        boolean(self.line, self.argument(parameter)?)
    }

    fn number_in(&self, parameter: usize, [min, max]: [f64; 2]) -> Result<f64, ScriptError> {
        let value = self.number(parameter)?;
        if (min..=max).contains(&value) { Ok(value) } else { Err(wrong(self.line, IN_RANGE, &Value::Number(value))) }
    }

    /// A number in a range, or its default.
    fn number_or(&self, parameter: usize, default: f64, range: [f64; 2]) -> Result<f64, ScriptError> {
        if self.value(parameter).is_some() { self.number_in(parameter, range) } else { Ok(default) }
    }

    fn register(&self, parameter: usize) -> Result<usize, ScriptError> {
        index(self.line, self.argument(parameter)?, REGISTERS, REGISTER)
    }

    fn bit(&self, parameter: usize) -> Result<usize, ScriptError> {
        index(self.line, self.argument(parameter)?, 128, BIT_REGISTER)
    }

    fn list<const N: usize>(&self, parameter: usize) -> Result<[f64; N], ScriptError> {
        let value = self.argument(parameter)?;
        let expected = if N == 6 { "list of six joint positions or speeds" } else { "list of three numbers" };
        let found = match value {
            Value::List(values) => values.as_slice().try_into().ok(),
            Value::Pose(values) => values.as_slice().try_into().ok(),
            _ => None,
        };
        let found: [f64; N] = found.ok_or_else(|| wrong(self.line, expected, value))?;
        if found.iter().all(|number| number.is_finite()) { Ok(found) } else { Err(wrong(self.line, expected, value)) }
    }

    fn pose(&self, parameter: usize) -> Result<Pose, ScriptError> {
        match self.argument(parameter)? {
            Value::Pose(_) => {
                let [x, y, z, rx, ry, rz] = self.list(parameter)?;
                Ok(Pose::from_rotation_vector(Vector3::new(x, y, z), Vector3::new(rx, ry, rz)))
            }
            other => Err(wrong(self.line, "pose", other)),
        }
    }

    fn done(&mut self, act: impl FnOnce(&mut Surroundings<'_>)) -> Value {
        act(self.around);
        Value::Nothing
    }

    /// The first cycle after a time, at least the next one.
    fn cycle_after(&self, time: f64) -> u64 {
        self.around.cycle + ((time * self.around.cycles_per_second).round() as u64).max(1)
    }

    fn begin(&mut self, motion: Motion) -> Result<(), ScriptError> {
        if self.around.may_move && self.around.body.begin(self.thread, motion) {
            Ok(())
        } else {
            Err(ScriptError::SecondMover { line: self.line })
        }
    }

    fn servoj(&mut self) -> Outcome {
        let target = self.list(0)?;
        let period = 1.0 / self.around.cycles_per_second;
        // Acceleration and speed are there, and the controller does not use them.
        self.number_or(1, 0.0, [0.0, f64::MAX])?;
        self.number_or(2, 0.0, [0.0, f64::MAX])?;
        let time = self.number_or(3, period, [f64::MIN_POSITIVE, 1.0])?;
        let lookahead = self.number_or(4, 0.1, LOOKAHEAD_RANGE)?;
        let gain = self.number_or(5, 300.0, GAIN_RANGE)?;
        // Shorter than a cycle is a cycle.
        let until = self.cycle_after(self.around.body.stretched(time));
        let command = ServoCommand { target, time: time.max(period), lookahead, gain };
        self.begin(Motion::Servo { command, until })?;
        Ok((Value::Nothing, Some(Waiting::Until(until))))
    }

    fn move_to(&mut self, line: bool) -> Outcome {
        let [acceleration, speed] = if line { MOVEL_DEFAULTS } else { MOVEJ_DEFAULTS };
        let body = &self.around.body;
        let goal = match (self.argument(0)?, line) {
            (Value::Pose(_), true) => Goal::Tool(self.pose(0)?),
            (Value::Pose(_), false) => {
                let pose = self.pose(0)?;
                let found = body.inverse(&pose, &body.servo.q);
                Goal::Joints(found.map_err(|_| wrong(self.line, "pose that the arm reaches", &pose_value(&pose)))?.0)
            }
            (_, false) => Goal::Joints(self.list(0)?),
            (_, true) => Goal::Tool(body.arm.forward(&JointPos(self.list(0)?)) * body.flange_from_tcp),
        };
        if let Goal::Joints(joints) = &goal
            && !self.is_within_range(joints)
        {
            return Err(wrong(self.line, "joints within the arm's range", &Value::List(joints.to_vec())));
        }
        let acceleration = self.number_or(1, acceleration, [f64::MIN_POSITIVE, f64::MAX])?;
        let speed = self.number_or(2, speed, [f64::MIN_POSITIVE, f64::MAX])?;
        let time = self.number_or(3, 0.0, [0.0, TIME_MAX])?;
        self.number_or(4, 0.0, [0.0, f64::MAX])?;
        self.begin(Motion::Move { goal, acceleration, speed, time })?;
        Ok((Value::Nothing, Some(Waiting::Motion)))
    }

    fn speed(&mut self, of_tool: bool) -> Outcome {
        let target = self.list(0)?;
        let acceleration = self.number_or(1, SPEEDJ_DEFAULT, [f64::MIN_POSITIVE, f64::MAX])?;
        let time = self.number_or(2, 0.0, [0.0, TIME_MAX])?;
        let until = (time > 0.0).then(|| self.cycle_after(self.around.body.stretched(time)));
        self.begin(Motion::Speed { target, of_tool, acceleration, until })?;
        Ok((Value::Nothing, Some(until.map_or(Waiting::Motion, Waiting::Until))))
    }

    fn stop(&mut self, of_tool: bool) -> Outcome {
        let deceleration = self.number_in(0, [f64::MIN_POSITIVE, f64::MAX])?;
        self.begin(Motion::Stop { deceleration, of_tool })?;
        Ok((Value::Nothing, Some(Waiting::Motion)))
    }

    fn is_within_range(&self, joints: &[f64; 6]) -> bool {
        let arm = &self.around.body.arm;
        let limits = arm.position_min.0.iter().zip(&arm.position_max.0);
        joints.iter().zip(limits).all(|(joint, (min, max))| (min..=max).contains(&joint))
    }

    /// Joints for a pose, nearest to those named or to where they are; None where there are none.
    fn inverse(&self) -> Result<Option<[f64; 6]>, ScriptError> {
        let body = &self.around.body;
        let pose = self.pose(0)?;
        let seed = self.value(1).map_or(Ok(body.servo.q.0), |_| self.list(1))?;
        // The errors allowed, of an iteration: the closed form has none.
        self.number_or(2, 1e-10, [0.0, f64::MAX])?;
        self.number_or(3, 1e-10, [0.0, f64::MAX])?;
        let tool = self.value(4).map_or(Ok(body.flange_from_tcp), |_| self.pose(4))?;
        Ok(body.inverse_with(&pose, &tool, &JointPos(seed)).ok().map(|joints| joints.0))
    }

    fn set_payload(&mut self, with_inertia: bool) -> Result<Value, ScriptError> {
        let mut payload = self.around.body.payload;
        payload.mass = self.number_in(0, [0.0, f64::MAX])?;
        if self.value(1).is_some() {
            payload.centre = self.list(1)?;
        }
        if with_inertia && self.value(2).is_some() {
            payload.inertia = self.list(2)?;
        }
        Ok(self.done(|around| around.body.payload = payload))
    }

    fn set_digital(&mut self, group: usize, count: usize) -> Result<Value, ScriptError> {
        let place = index(self.line, self.argument(0)?, count, "number of an output")?;
        let on = self.boolean(1)?;
        Ok(self.done(|around| around.outputs.set_digital(group, place, on)))
    }

    fn digital_input(&self, first: usize, count: usize) -> Result<Value, ScriptError> {
        let place = index(self.line, self.argument(0)?, count, "number of an input")?;
        Ok(Value::Boolean(self.around.cell.digital >> (first + place) & 1 == 1))
    }

    fn analog_input(&self, first: usize) -> Result<Value, ScriptError> {
        let place = index(self.line, self.argument(0)?, 2, "number of an input")?;
        Ok(Value::Number(self.around.cell.analog.get(first + place).copied().unwrap_or(0.0)))
    }

    fn set_watchdog(&mut self) -> Result<Value, ScriptError> {
        let text = |value: &Value| match value {
            Value::Text(text) => Ok(text.clone()),
            other => Err(wrong(self.line, "string", other)),
        };
        let name = text(self.argument(0)?)?;
        let frequency = self.number_in(1, [f64::MIN_POSITIVE, self.around.cycles_per_second])?;
        let action = self.value(2).map_or(Ok("pause".to_owned()), text)?;
        // The maker's own programs write it in capitals.
        let action = match action.to_ascii_lowercase().as_str() {
            "ignore" => WatchdogAction::Ignore,
            "pause" => WatchdogAction::Pause,
            "stop" => WatchdogAction::Stop,
            _ => return Err(wrong(self.line, "\"ignore\", \"pause\" or \"stop\"", &Value::Text(action))),
        };
        let Some((input, _)) = self.around.inputs.find(name.as_bytes()) else {
            return Err(wrong(self.line, "name of an RTDE input", &Value::Text(name)));
        };
        self.around.watchdogs.push(WatchdogRequest { input, period: 1.0 / frequency, action });
        Ok(Value::Nothing)
    }
}

/// Positions added, rotations multiplied (URScript manual, `pose_add`).
fn add(first: &Pose, second: &Pose) -> Pose {
    Pose { rotation: first.rotation * second.rotation, translation: first.translation + second.translation }
}

fn pose_value(pose: &Pose) -> Value {
    Value::Pose(numbers(pose))
}
