//! Ports 30001 to 30003 take scripts as plain text without a length: a program is complete with the line that ends its last
//! block, and a line outside any block is a program by itself. Bytes are arguments.

use super::lexer::depth_change;

/// Lines that are commands to the controller and no script, as the maker's own clients send them on port 30001
/// (`src/primary/primary_client.cpp` of the Universal_Robots_Client_Library).
const COMMANDS: [&str; 5] =
    ["power on", "power off", "set robotmode run", "set unlock protective stop", "stop program"];
/// Longest script that is taken.
const SCRIPT_MAX: usize = 4 * 1024 * 1024;

/// The text of one connection, until it makes a program.
#[derive(Clone, Debug, Default)]
pub struct Upload {
    /// Bytes behind the last line break.
    line: Vec<u8>,
    /// Complete lines of a program that is not.
    program: String,
    /// Blocks that are open.
    depth: i32,
    programs: Vec<String>,
    overflow: bool,
}

impl Upload {
    /// Takes bytes, split anywhere.
    pub fn handle_bytes(&mut self, bytes: &[u8]) {
        for byte in bytes {
            if self.line.len() + self.program.len() >= SCRIPT_MAX {
                self.overflow = true;
                return;
            }
            if *byte == b'\n' {
                let line = String::from_utf8_lossy(&std::mem::take(&mut self.line)).into_owned();
                self.take_line(&line);
            } else {
                self.line.push(*byte);
            }
        }
    }

    fn take_line(&mut self, line: &str) {
        if self.depth == 0 && COMMANDS.contains(&line.trim()) {
            self.programs.push(line.trim().to_owned());
            return;
        }
        // A line that is no script is judged with its program, which then has a place to name.
        let change = depth_change(line).unwrap_or(0);
        let outside = self.depth == 0;
        let first = line.trim_start().split(|c: char| !c.is_ascii_alphanumeric() && c != '_').next();
        let opens = outside && matches!(first, Some("def" | "sec"));
        if outside && !opens {
            if change == 0 && !is_blank(line) {
                self.programs.push(format!("def unnamed(): {line}\nend\n"));
            }
            return;
        }
        self.program.push_str(line);
        self.program.push('\n');
        self.depth += change;
        if self.depth <= 0 {
            self.depth = 0;
            self.programs.push(std::mem::take(&mut self.program));
        }
    }

    /// The programs and commands that are complete, oldest first.
    pub fn take_programs(&mut self) -> Vec<String> {
        std::mem::take(&mut self.programs)
    }

    /// Whether more came than a script can be; the connection is then of no use.
    pub const fn is_overflown(&self) -> bool {
        self.overflow
    }
}

fn is_blank(line: &str) -> bool {
    let text = line.trim();
    text.is_empty() || text.starts_with(['#', '$'])
}

#[cfg(test)]
mod tests {
    use super::*;

    const PROGRAM: &str = "def a():\n  # end\n  while (True):\n    if x == \"end\": y = 1 end\n  end\nend\n";

    #[test]
    fn programs_are_found_however_the_bytes_are_split() {
        let text = format!("\n# nothing\n{PROGRAM}stopj(2)\n{PROGRAM}def b():\n");
        for chunk in [1, 2, 3, 7, 1000] {
            let mut upload = Upload::default();
            let mut found = Vec::new();
            for bytes in text.as_bytes().chunks(chunk) {
                upload.handle_bytes(bytes);
                found.extend(upload.take_programs());
            }
            assert_eq!(found, [PROGRAM, "def unnamed(): stopj(2)\nend\n", PROGRAM], "{chunk} bytes at once");
        }
    }

    #[test]
    fn a_word_that_only_begins_as_a_block_does_is_a_line_by_itself() {
        let mut upload = Upload::default();
        upload.handle_bytes(b"sector = 1\ndefault(2)\ndef_x()\nsec s():\nend\ndef\ta(): x = 1 end\n");
        let lines = ["sector = 1", "default(2)", "def_x()"].map(|line| format!("def unnamed(): {line}\nend\n"));
        let found = upload.take_programs();
        assert_eq!(found[..3], lines);
        assert_eq!(found[3..], ["sec s():\nend\n", "def\ta(): x = 1 end\n"]);
    }

    #[test]
    fn too_much_is_noticed_and_not_kept() {
        let mut upload = Upload::default();
        for _ in 0..SCRIPT_MAX / 1000 + 2 {
            upload.handle_bytes(&[b'x'; 1000]);
        }
        assert!(upload.is_overflown());
        assert!(upload.line.len() <= SCRIPT_MAX);
    }
}
