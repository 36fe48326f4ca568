//! Arithmetic, comparisons, lists.

use crate::sim::ur::script::ScriptError;
use crate::sim::ur::script::code::{Op, Operator, Value};

/// Length of a text that a script can build.
const TEXT_MAX: usize = 4096;

pub(super) fn wrong(line: usize, expected: &'static str, found: &Value) -> ScriptError {
    let found = match found {
        Value::Text(text) => format!("\"{text}\""),
        other => other.to_string(),
    };
    ScriptError::Value { line, expected, found }
}

pub(super) fn number(line: usize, value: &Value) -> Result<f64, ScriptError> {
    match value {
        Value::Number(value) => Ok(*value),
        other => Err(wrong(line, "number", other)),
    }
}

pub(super) fn boolean(line: usize, value: &Value) -> Result<bool, ScriptError> {
    match value {
        Value::Boolean(value) => Ok(*value),
        other => Err(wrong(line, "True or False", other)),
    }
}

/// A thread's handle; 0 is none.
pub(super) fn handle(line: usize, value: &Value) -> Result<u32, ScriptError> {
    let found = number(line, value)?;
    let handle = found as u32;
    if f64::from(handle) == found { Ok(handle) } else { Err(wrong(line, "thread", value)) }
}

/// A whole number from 0, below the limit.
pub(super) fn index(line: usize, value: &Value, limit: usize, expected: &'static str) -> Result<usize, ScriptError> {
    let found = number(line, value)?;
    let index = found as usize;
    if index < limit && index as f64 == found { Ok(index) } else { Err(wrong(line, expected, value)) }
}

const INDEX: &str = "index of an element";

pub(super) fn set_element(line: usize, variable: &mut Value, place: &Value, value: &Value) -> Result<(), ScriptError> {
    let value = number(line, value)?;
    let elements: &mut [f64] = match variable {
        Value::List(elements) => elements,
        Value::Pose(elements) => elements,
        other => return Err(wrong(line, "list or pose", other)),
    };
    let place = index(line, place, elements.len(), INDEX)?;
    if let Some(element) = elements.get_mut(place) {
        *element = value;
    }
    Ok(())
}

/// The instructions that only take values from the stack and put one.
pub(super) fn compute(line: usize, op: &Op, stack: &mut Vec<Value>) -> Result<(), ScriptError> {
    let mut pop = || stack.pop().unwrap_or(Value::Nothing);
    let result = match op {
        Op::Negate => match pop() {
            Value::Number(value) => Value::Number(-value),
            Value::List(values) => Value::List(values.iter().map(|value| -value).collect()),
            other => return Err(wrong(line, "number", &other)),
        },
        Op::Not => Value::Boolean(!boolean(line, &pop())?),
        Op::Element => {
            let (place, of) = (pop(), pop());
            let elements: &[f64] = match &of {
                Value::List(elements) => elements,
                Value::Pose(elements) => elements,
                other => return Err(wrong(line, "list or pose", other)),
            };
            let place = index(line, &place, elements.len(), INDEX)?;
            Value::Number(elements.get(place).copied().unwrap_or(f64::NAN))
        }
        Op::List(count) => Value::List(numbers(line, *count, &mut pop)?),
        Op::Pose => {
            let mut pose = [0.0; 6];
            pose.copy_from_slice(&numbers(line, 6, &mut pop)?);
            Value::Pose(pose)
        }
        Op::Binary(operator) => {
            let (right, left) = (pop(), pop());
            binary(line, *operator, left, right)?
        }
        // The machine itself does the others.
        _ => return Ok(()),
    };
    stack.push(result);
    Ok(())
}

fn numbers(line: usize, count: usize, pop: &mut impl FnMut() -> Value) -> Result<Vec<f64>, ScriptError> {
    let mut numbers = Vec::with_capacity(count);
    for _ in 0..count {
        numbers.push(number(line, &pop())?);
    }
    numbers.reverse();
    Ok(numbers)
}

fn binary(line: usize, operator: Operator, left: Value, right: Value) -> Result<Value, ScriptError> {
    Ok(match operator {
        Operator::And | Operator::Or | Operator::Xor => {
            let (left, right) = (boolean(line, &left)?, boolean(line, &right)?);
            Value::Boolean(match operator {
                Operator::And => left && right,
                Operator::Or => left || right,
                _ => left != right,
            })
        }
        Operator::Add | Operator::Subtract | Operator::Multiply | Operator::Divide | Operator::Remainder => {
            arithmetic(line, operator, left, right)?
        }
        _ => Value::Boolean(compare(line, operator, &left, &right)?),
    })
}

fn arithmetic(line: usize, operator: Operator, left: Value, right: Value) -> Result<Value, ScriptError> {
    let on = |left: f64, right: f64| match operator {
        Operator::Add => left + right,
        Operator::Subtract => left - right,
        Operator::Multiply => left * right,
        Operator::Divide => left / right,
        _ => left % right,
    };
    match (left, right) {
        (Value::Number(_), Value::Number(0.0)) if matches!(operator, Operator::Divide | Operator::Remainder) => {
            Err(wrong(line, "divisor other than zero", &Value::Number(0.0)))
        }
        (Value::Number(left), Value::Number(right)) => Ok(Value::Number(on(left, right))),
        (Value::List(left), Value::List(right)) if left.len() == right.len() => {
            Ok(Value::List(left.iter().zip(&right).map(|(left, right)| on(*left, *right)).collect()))
        }
        (Value::List(values), Value::Number(by)) => {
            Ok(Value::List(values.iter().map(|value| on(*value, by)).collect()))
        }
        (Value::Text(left), right) if operator == Operator::Add => {
            let text = format!("{left}{right}");
            if text.len() > TEXT_MAX {
                return Err(ScriptError::TooMuch { line, what: "bytes of text", limit: TEXT_MAX });
            }
            Ok(Value::Text(text))
        }
        (left @ (Value::Number(_) | Value::List(_)), right) => {
            Err(wrong(line, "two values that can be computed", if is_plain(&left) { &right } else { &left }))
        }
        (left, _) => Err(wrong(line, "number", &left)),
    }
}

const fn is_plain(value: &Value) -> bool {
    matches!(value, Value::Number(_))
}

fn compare(line: usize, how: Operator, left: &Value, right: &Value) -> Result<bool, ScriptError> {
    let alike = std::mem::discriminant(left) == std::mem::discriminant(right);
    match (how, left, right) {
        (_, Value::Number(a), Value::Number(b)) => Ok(match how {
            Operator::Equal => a == b,
            Operator::NotEqual => a != b,
            Operator::Less => a < b,
            Operator::LessOrEqual => a <= b,
            Operator::Greater => a > b,
            _ => a >= b,
        }),
        (Operator::Equal, ..) if alike => Ok(left == right),
        (Operator::NotEqual, ..) if alike => Ok(left != right),
        _ => Err(wrong(line, "two values that can be compared", right)),
    }
}
