//! The command line of Screed.

fn main() {}
