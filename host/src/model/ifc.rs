//! What IFC's units, placements and curves mean.
