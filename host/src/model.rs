//! From ISO 10303-21 text to what is to be built.
