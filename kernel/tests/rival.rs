//! The kernel's filter against the paper's, printed and mended.

mod common;

use common::plant::{PAPER, TRACKER};
use common::rival::rivals;

/// At either noise ours is as good as the paper's with its line mended. As printed that line makes the filter sure of what it has not seen.
#[test]
fn ours_is_no_worse_than_the_papers_and_the_printed_line_is_an_error() {
    for noise in [TRACKER, PAPER] {
        let result = rivals(0..50, noise, 400);
        let [difference, half] = result.difference;
        assert!(difference <= half.max(0.01), "{noise:?}: {result:?}");
        assert!(result.ours.joints <= 1.05 * result.literal.joints, "{noise:?}: {result:?}");
        assert!(result.printed.place > 1.2 * result.literal.place, "{noise:?}: {result:?}");
    }
}
