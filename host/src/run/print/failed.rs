//! What the failure of a print means to the shell and to a person: class, remedy, and what goes on from there.

use crate::failure::{Exit, Failure};
use crate::run::children;
use crate::run::session::SessionError;
use std::path::{Path, PathBuf};

/// The commands that go on with a print after a failure.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Again {
    /// The cell file, where its robot has a controller.
    pub robot: Option<PathBuf>,
    /// The print itself, but for its layers.
    pub print: String,
    /// One past the last layer, where only some were wanted.
    pub end: Option<usize>,
}

/// A path as a shell reads it.
pub fn quoted(path: &Path) -> String {
    let text = path.display().to_string();
    let is_plain = |c: char| c.is_alphanumeric() || "/._-+,:@%".contains(c);
    if !text.is_empty() && text.chars().all(is_plain) { text } else { format!("'{}'", text.replace('\'', "'\\''")) }
}

/// A failure on the path, with the commands that go on from there.
pub(super) fn going_on(mut failure: Failure, again: &Again, layer: usize) -> Failure {
    let Again { robot, print, end } = again;
    let robot = robot.as_ref().map_or_else(String::new, |cell| {
        let cell = quoted(cell);
        format!(
            "screed robot status --cell {cell} names what stands in the way (unlock after a protective stop, power-on and \
             brake-release after an emergency stop, stop for a held program); then "
        )
    });
    let layers = end.map_or_else(String::new, |end| format!(" --layers {}", end.saturating_sub(layer)));
    if let Some(problem) = failure.problems.first_mut() {
        let first = problem.remedy.take().map_or_else(String::new, |remedy| remedy + "; ");
        problem.remedy = Some(format!(
            "{first}{robot}{print} --from-layer {layer}{layers} goes on with the layer that was being laid"
        ));
    }
    failure
}

/// What a session's failure means to the shell.
impl From<SessionError> for Failure {
    fn from(error: SessionError) -> Self {
        use crate::run::job::JobError;
        match error {
            SessionError::Plan(error) | SessionError::Job(JobError::Plan(error)) => error.into(),
            SessionError::Log(error) => error.into(),
            SessionError::Job(error) => {
                let (exit, remedy) = match &error {
                    JobError::Fault(report) => (Exit::SafetyStop, report.fault.action()),
                    JobError::Unanswered { .. } | JobError::Reset => (
                        Exit::Link,
                        "mend the line, see where the arm stands, then start again; nothing moves by itself",
                    ),
                    JobError::Link(text) => return Self::told(Exit::Link, text),
                    JobError::Underrun { .. } => (Exit::Failed, "run on a quieter machine"),
                    _ => (Exit::Failed, "start screed and screed-rt of the same build; report this if they are"),
                };
                Self::new(exit, error.to_string(), remedy)
            }
        }
    }
}

impl From<children::ChildError> for Failure {
    fn from(error: children::ChildError) -> Self {
        match error {
            children::ChildError::Ended { code, message } => {
                let exit = match code {
                    Some(3) => Exit::Input,
                    Some(4) => Exit::Link,
                    Some(6) => Exit::NotRealTime,
                    _ => Exit::Failed,
                };
                let (message, remedy) = match message.split_once("\nremedy: ") {
                    Some((message, remedy)) => (message.to_owned(), remedy.to_owned()),
                    None => (message, "start it by hand to see what is wrong".to_owned()),
                };
                Self::new(exit, message, remedy)
            }
            error @ children::ChildError::Spawn { .. } => {
                Self::new(Exit::Failed, error.to_string(), "install both programs, screed and screed-rt, in one folder")
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_path_is_quoted_where_a_shell_would_take_it_apart() {
        for (path, text) in
            [("a/b-1.toml", "a/b-1.toml"), ("sp ace.ifc", "'sp ace.ifc'"), ("it's", "'it'\\''s'"), ("$x", "'$x'")]
        {
            assert_eq!(quoted(Path::new(path)), text);
        }
    }
}
