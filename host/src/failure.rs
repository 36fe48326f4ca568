//! What a person is told when something fails, and with which exit code: one place, printed once.

use std::fmt;
use std::ops::Range;
use std::process::ExitCode;

/// The class of a failure, as documented in `docs/exit-codes.md`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Exit {
    /// 1: something failed that no other class names (a file that cannot be written, a damaged log).
    Failed,
    /// 2: the command line makes no sense.
    Usage,
    /// 3: the cell file or the model is wrong, or the job cannot be done with them.
    Input,
    /// 4: a robot, an extruder or the real-time process cannot be reached, is silent or talks nonsense.
    Link,
    /// 5: a limit, a watchdog or the robot's own safety stopped the motion.
    SafetyStop,
    /// 6: the system refused real-time scheduling, locked memory or the processor.
    NotRealTime,
    /// 130: a person stopped the job with Ctrl-C (128 + SIGINT, as shells report it).
    Interrupted,
}

impl Exit {
    /// The number the process ends with.
    pub const fn code(self) -> u8 {
        match self {
            Self::Failed => 1,
            Self::Usage => 2,
            Self::Input => 3,
            Self::Link => 4,
            Self::SafetyStop => 5,
            Self::NotRealTime => 6,
            Self::Interrupted => 130,
        }
    }
}

impl From<Exit> for ExitCode {
    fn from(exit: Exit) -> Self {
        Self::from(exit.code())
    }
}

/// Everything that went wrong in one run of the program.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Failure {
    /// The exit code's class.
    pub exit: Exit,
    /// At least one.
    pub problems: Vec<Problem>,
}

impl Failure {
    /// One problem without a place in a file.
    pub fn new(exit: Exit, message: impl Into<String>, remedy: impl Into<String>) -> Self {
        let problem = Problem { message: message.into(), excerpt: None, remedy: Some(remedy.into()) };
        Self { exit, problems: vec![problem] }
    }
}

impl Failure {
    /// From an error's text; behind its last semicolon stands the remedy.
    pub fn told(exit: Exit, text: impl Into<String>) -> Self {
        let text = text.into();
        let (message, remedy) = match text.rsplit_once("; ") {
            Some((message, remedy)) => (message.to_owned(), Some(remedy.to_owned())),
            None => (text, None),
        };
        Self { exit, problems: vec![Problem { message, excerpt: None, remedy }] }
    }

    /// From the text of an error of a link; behind its last semicolon or, where the cause needs no words, its last colon stands the
    /// remedy.
    pub fn link(text: &str) -> Self {
        match text.rsplit_once("; ").or_else(|| text.rsplit_once(": ")) {
            Some((message, remedy)) => Self::new(Exit::Link, message, remedy),
            None => Self::new(Exit::Link, text, "see the log on the robot's teach pendant, then start again"),
        }
    }

    /// The same with a place in a file.
    pub fn at(mut self, excerpt: Excerpt) -> Self {
        if let Some(problem) = self.problems.first_mut() {
            problem.excerpt = Some(excerpt);
        }
        self
    }
}

impl std::error::Error for Failure {}

impl fmt::Display for Failure {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for (index, problem) in self.problems.iter().enumerate() {
            if index > 0 {
                writeln!(f)?;
            }
            write!(f, "{problem}")?;
        }
        Ok(())
    }
}

/// One thing that is wrong, where, and what to do about it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Problem {
    /// What is wrong, with what was expected and what was found.
    pub message: String,
    /// Where, when a file is to blame.
    pub excerpt: Option<Excerpt>,
    /// What to do.
    pub remedy: Option<String>,
}

impl fmt::Display for Problem {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "error: {}", self.message)?;
        if let Some(excerpt) = &self.excerpt {
            write!(f, "\n{excerpt}")?;
        }
        if let Some(remedy) = &self.remedy {
            write!(f, "\nremedy: {remedy}")?;
        }
        Ok(())
    }
}

/// A place in a text file, with the line it is on.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Excerpt {
    /// The file's name as the person gave it.
    pub file: String,
    /// Line, the first is 1.
    pub line: usize,
    /// Column in characters, the first is 1.
    pub column: usize,
    /// The part of the line that is shown; control characters are replaced, long lines are cut around the place.
    shown: String,
    /// Characters of `shown` before the place.
    indent: usize,
    /// Characters to underline.
    width: usize,
}

/// Characters of context kept on either side of a place in a long line (IFC lines can be very long).
const CONTEXT: usize = 60;

impl Excerpt {
    /// The place of the bytes `span` in `source`; a span beyond the end points at the end. Only the first line of a
    /// longer span is shown.
    pub fn new(file: &str, source: &[u8], span: Range<usize>) -> Self {
        let start = span.start.min(source.len());
        let before = source.get(..start).unwrap_or_default();
        let line_start = before.iter().rposition(|&byte| byte == b'\n').map_or(0, |newline| newline + 1);
        let rest = source.get(start..).unwrap_or_default();
        let line_end = rest.iter().position(|&byte| byte == b'\n').map_or(source.len(), |length| start + length);
        let text = |range: Range<usize>| String::from_utf8_lossy(source.get(range).unwrap_or_default()).into_owned();
        let (left, right) = (text(line_start..start), text(start..line_end));
        let marked = text(start..span.end.clamp(start, line_end)).chars().count().max(1);
        let column = left.chars().count() + 1;

        let skip = left.chars().count().saturating_sub(CONTEXT);
        let indent = left.chars().count() - skip;
        let visible = |character: char| if character.is_control() { ' ' } else { character };
        let right = right.trim_end_matches('\r');
        let shown = left.chars().skip(skip).chain(right.chars().take(CONTEXT)).map(visible).collect();
        let line = before.iter().filter(|&&byte| byte == b'\n').count() + 1;
        Self { file: file.to_owned(), line, column, shown, indent, width: marked.min(CONTEXT) }
    }
}

impl fmt::Display for Excerpt {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let gutter = self.line.to_string().len();
        let Self { file, line, column, shown, .. } = self;
        writeln!(f, "{:gutter$}--> {file}:{line}:{column}", "")?;
        writeln!(f, "{line} | {shown}")?;
        write!(f, "{:gutter$} | {:indent$}{}", "", "", "^".repeat(self.width), indent = self.indent)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_excerpt_underlines_the_place_by_characters_not_bytes() {
        let source = "a = 1\nname = \"Größe\" # x\r\nb = 2\n";
        let start = source.find("# x").unwrap_or_default();
        let excerpt = Excerpt::new("cell.toml", source.as_bytes(), start..start + 3);
        assert_eq!((excerpt.line, excerpt.column), (2, 16));
        let text = excerpt.to_string();
        assert_eq!(text, " --> cell.toml:2:16\n2 | name = \"Größe\" # x\n  |                ^^^");
    }

    #[test]
    fn spans_beyond_the_end_and_long_lines_stay_readable() {
        let end = Excerpt::new("f", b"ab", 9..12);
        assert_eq!((end.line, end.column), (1, 3));
        let long = "x".repeat(100_000);
        let middle = Excerpt::new("f", long.as_bytes(), 50_000..90_000);
        assert_eq!((middle.line, middle.column), (1, 50_001));
        assert!(middle.to_string().len() < 300, "{middle}");
        let empty = Excerpt::new("f", b"", 0..0);
        assert_eq!((empty.line, empty.column), (1, 1));
        let crooked = Excerpt::new("f", b"abc\ndef", Range { start: 5, end: 2 });
        assert_eq!((crooked.line, crooked.column), (2, 2));
    }

    #[test]
    fn a_failure_puts_each_remedy_on_its_own_line() {
        let failure = Failure::new(Exit::Input, "the wall is out of reach", "move the part nearer");
        assert_eq!(failure.to_string(), "error: the wall is out of reach\nremedy: move the part nearer");
        assert_eq!(failure.exit.code(), 3);
    }
}
