//! A person at the terminal.

use std::io::{self, IsTerminal};

/// What was typed before a question is no answer to it: nobody had read the question.
pub fn forget_typed() {
    if io::stdin().is_terminal() {
        // SAFETY: tcflush takes a descriptor, and reports a bad one.
        unsafe { libc::tcflush(libc::STDIN_FILENO, libc::TCIFLUSH) };
    }
}
