//! Geometry of a layer.
