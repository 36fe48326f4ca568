//! The controller's properties, which clients of newer software ask for by name (`RTDE_READ_PROPERTIES`, from software 5.26
//! on): the names go there as a list; back come the length of the list of types, that list, and the values when every name is
//! known. Layout and encodings as in `rtde/rtde.py` and `rtde/rtde_decode.py` of the RTDE_Python_Client_Library.

use super::robot::Generation;
use crate::link::rtde::wire::list_entries;

/// The package's type.
pub(super) const CODE: u8 = b'R';
/// Type 5, revision 0: the e-Series' control box; and its tool flange, of which the simulation has one kind.
const CONTROL_BOX: u32 = 5 << 24;
const TOOL_FLANGE: u32 = 1 << 24;

/// The answer to a list of names.
pub(super) fn answer(names: &[u8], generation: Generation) -> Vec<u8> {
    let [major, minor, bugfix, build] = generation.software().map(u64::from);
    let version = major << 48 | minor << 32 | bugfix << 16 | build;
    let (mut types, mut values, mut complete) = (Vec::new(), Vec::new(), true);
    for name in list_entries(names) {
        match name {
            b"v1.software.version" => {
                types.push("UINT64");
                values.extend(version.to_be_bytes());
            }
            b"v1.control_box.type" => {
                types.push("UINT32");
                values.extend(CONTROL_BOX.to_be_bytes());
            }
            b"v1.robot_arm.tool_flange.type" => {
                types.push("UINT32");
                values.extend(TOOL_FLANGE.to_be_bytes());
            }
            _ => {
                types.push("NOT_FOUND");
                complete = false;
            }
        }
    }
    let types = types.join(",");
    // A list that is longer does not fit into a package either, which the session tells.
    let mut out = u16::try_from(types.len()).unwrap_or(u16::MAX).to_be_bytes().to_vec();
    out.extend(types.bytes());
    if complete {
        out.extend(values);
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn known_names_have_values_and_one_unknown_name_takes_all_of_them() {
        let names = b"v1.software.version,v1.control_box.type,v1.robot_arm.tool_flange.type";
        let found = answer(names, Generation::ESeries);
        assert_eq!(found[..22], *b"\x00\x14UINT64,UINT32,UINT32");
        assert_eq!(found[22..30], [0, 5, 0, 11, 0, 6, 0, 1]);
        assert_eq!(found[30..], [5, 0, 0, 0, 1, 0, 0, 0]);
        let found = answer(b"v1.software.version,v1.x", Generation::ESeries);
        assert_eq!(found, b"\x00\x10UINT64,NOT_FOUND");
    }
}
