//! A URDF's links and joints.

use super::{Ends, Located, UrdfFault};
use nalgebra::{Unit, Vector3};
use roxmltree::{Document, Node};
use screed_kernel::pose::Pose;
use std::collections::BTreeSet;
use std::f64::consts::PI;
use std::ops::Range;

/// What is read of a file.
#[derive(Debug)]
pub(super) struct Tree {
    pub name: String,
    /// The robot element's first line.
    pub span: Range<usize>,
    links: Vec<String>,
    pub joints: Vec<UrdfJoint>,
    /// What stands in the file and is not read.
    pub notes: Vec<String>,
}

/// Elements of a robot and of a joint that say nothing about where links are.
const BESIDE_LINKS: [&str; 5] = ["material", "gazebo", "transmission", "sensor", "ros2_control"];
const BESIDE_AXES: [&str; 2] = ["calibration", "dynamics"];
/// Elements of a joint that are read, each once, with their attributes.
const READ: [(&str, &[&str]); 7] = [
    ("parent", &["link"]),
    ("child", &["link"]),
    ("origin", &["xyz", "rpy"]),
    ("axis", &["xyz"]),
    ("limit", &["lower", "upper", "velocity", "effort", "acceleration", "deceleration", "jerk"]),
    ("mimic", &["joint", "multiplier", "offset"]),
    ("safety_controller", &["soft_lower_limit", "soft_upper_limit", "k_position", "k_velocity"]),
];

/// The largest numbers of a file, as of an arm file: lengths (m), positions (rad), speeds (rad/s, m/s); and of what has no unit.
/// What is larger stands for something else, such as "without limit".
const LENGTH_MAX: f64 = 1_000.0;
const TURN_MAX: f64 = 200.0 * PI;
const TURN_SPEED_MAX: f64 = 10_000.0 / 180.0 * PI;
const SLIDE_SPEED_MAX: f64 = 100.0;
const SHARE_MAX: f64 = 1_000.0;

/// A joint as the file has it.
#[derive(Debug)]
pub(super) struct UrdfJoint {
    pub name: String,
    pub span: Range<usize>,
    /// Its type.
    pub kind: String,
    parent: String,
    child: String,
    pub origin: Pose,
    pub axis: Unit<Vector3<f64>>,
    /// Lowest and highest position (rad, m); infinite for a continuous joint, `None` where the file says nothing.
    pub range: Option<[f64; 2]>,
    /// Highest speed (rad/s, m/s), where it is given and not zero.
    pub velocity_max: Option<f64>,
    pub mimic: Option<Mimic>,
    pub has_soft_limits: bool,
}

/// The joints of a way that move, each with its pose in the frame of the one before, and the end in the last one's frame.
pub(super) type Path<'a> = (Vec<(Pose, &'a UrdfJoint)>, Pose);

/// Position = multiplier · position of another joint + offset.
#[derive(Clone, Debug)]
pub(super) struct Mimic {
    pub joint: String,
    pub multiplier: f64,
    pub offset: f64,
}

impl UrdfJoint {
    pub fn moves(&self) -> bool {
        self.kind != "fixed"
    }

    pub fn is_revolute(&self) -> bool {
        matches!(self.kind.as_str(), "revolute" | "continuous")
    }
}

/// Reads the links and joints of a text.
pub(super) fn read(text: &str) -> Result<Tree, Located> {
    let document = Document::parse(text).map_err(|error| {
        let at = error.pos();
        let line: usize = text.split_inclusive('\n').take(at.row.saturating_sub(1) as usize).map(str::len).sum();
        let start = line + at.col.saturating_sub(1) as usize;
        (start..start + 1, UrdfFault::Xml { message: error.to_string() })
    })?;
    let robot = document.root_element();
    if robot.tag_name().name() != "robot" {
        return Err(form(&robot, "the file".to_owned(), "an element robot", robot.tag_name().name()));
    }
    if let Some(node) = robot.descendants().find(is_xacro) {
        return Err((head(&node), UrdfFault::Xacro { found: format!("xacro:{}", node.tag_name().name()) }));
    }
    let mut notes = Vec::new();
    for node in robot.children().filter(|node| node.is_element()) {
        let name = node.tag_name().name();
        match name {
            "link" => {}
            "joint" => joint_notes(&node, &mut notes)?,
            // A joint by another name would be an axis dropped.
            _ if ["parent", "child"].iter().all(|end| node.children().any(|node| node.has_tag_name(*end))) => {
                return Err(form(&node, "the file".to_owned(), "an element joint", name));
            }
            _ if BESIDE_LINKS.contains(&name) => {}
            _ => notes.push(format!("element {name} is not read")),
        }
    }
    let elements = |name| robot.children().filter(move |node| node.has_tag_name(name));
    let links = elements("link").map(|node| text_of(&node, "link", "name")).collect::<Result<Vec<_>, _>>()?;
    let joints = elements("joint").map(|node| joint(&node)).collect::<Result<Vec<_>, _>>()?;
    let name = text_of(&robot, "robot", "name")?;
    let tree = Tree { name, span: head(&robot), links, joints, notes };
    tree.check()?;
    Ok(tree)
}

/// What the xacro tool has to replace: an element in its namespace, or with its prefix.
fn is_xacro(node: &Node<'_, '_>) -> bool {
    let text = node.document().input_text().get(node.range()).unwrap_or_default();
    node.is_element()
        && (node.tag_name().namespace().is_some_and(|uri| uri.contains("xacro")) || text.starts_with("<xacro:"))
}

/// Notes what of a joint is not read; an error where what is read stands twice or has attributes that are not.
fn joint_notes(joint: &Node<'_, '_>, notes: &mut Vec<String>) -> Result<(), Located> {
    let entity = format!("joint {}", joint.attribute("name").unwrap_or_default());
    let elements = || joint.children().filter(|node| node.is_element());
    for node in elements() {
        let name = node.tag_name().name();
        let Some((_, attributes)) = READ.iter().find(|(read, _)| *read == name) else {
            if !BESIDE_AXES.contains(&name) {
                notes.push(format!("{entity} has an element {name}, which is not read"));
            }
            continue;
        };
        if elements().filter(|other| other.has_tag_name(name)).count() > 1 {
            return Err(form(&node, entity, &format!("one element {name}"), "more"));
        }
        if let Some(unread) = node.attributes().find(|attribute| !attributes.contains(&attribute.name())) {
            let expected = format!("an attribute {}", attributes.join(" or "));
            return Err(form(&node, format!("{entity}: {name}"), &expected, unread.name()));
        }
    }
    let turns = joint.attribute("type").is_some_and(|kind| kind != "fixed" && kind != "floating");
    if turns && !elements().any(|node| node.has_tag_name("axis")) {
        notes.push(format!("{entity} has no axis: it is along x, as URDF has it"));
    }
    Ok(())
}

/// An element's first tag, for excerpts.
fn head(node: &Node<'_, '_>) -> Range<usize> {
    let range = node.range();
    let text = node.document().input_text().get(range.clone()).unwrap_or_default();
    range.start..range.start + text.find('>').map_or(text.len(), |end| end + 1)
}

fn form(node: &Node<'_, '_>, entity: String, expected: &str, found: &str) -> Located {
    (head(node), UrdfFault::Form { entity, expected: expected.to_owned(), found: format!("{found:?}") })
}

fn text_of(node: &Node<'_, '_>, entity: &str, attribute: &str) -> Result<String, Located> {
    let found = node.attribute(attribute).filter(|text| !text.is_empty());
    found.map(str::to_owned).ok_or_else(|| form(node, entity.to_owned(), &format!("an attribute {attribute}"), ""))
}

fn joint(node: &Node<'_, '_>) -> Result<UrdfJoint, Located> {
    let name = text_of(node, "joint", "name")?;
    let entity = format!("joint {name}");
    let kind = text_of(node, &entity, "type")?;
    if !["revolute", "continuous", "prismatic", "fixed", "floating", "planar"].contains(&kind.as_str()) {
        let expected = "a type revolute, continuous, prismatic, fixed, floating or planar";
        return Err(form(node, entity, expected, &kind));
    }
    let child = |name| node.children().find(|node| node.has_tag_name(name));
    let link = |name: &'static str| match child(name) {
        Some(node) => text_of(&node, &format!("{entity}: {name}"), "link"),
        None => Err(form(node, entity.clone(), &format!("an element {name}"), "none")),
    };
    let (parent, child_link) = (link("parent")?, link("child")?);
    let origin = match child("origin") {
        Some(node) => {
            let [x, y, z] = three(&node, &entity, "xyz", [0.0; 3], LENGTH_MAX)?;
            let [roll, pitch, yaw] = three(&node, &entity, "rpy", [0.0; 3], TURN_MAX)?;
            Pose::from_roll_pitch_yaw(Vector3::new(x, y, z), roll, pitch, yaw)
        }
        None => Pose::identity(),
    };
    let axis = match child("axis") {
        Some(axis) => {
            let entity = format!("{entity}: axis");
            let direction = Vector3::from(three(&axis, &entity, "xyz", [1.0, 0.0, 0.0], SHARE_MAX)?);
            Unit::try_new(direction, 1e-6).ok_or_else(|| form(&axis, entity, "a direction", "0 0 0"))?
        }
        None => Vector3::x_axis(),
    };
    let mimic = match child("mimic") {
        Some(node) => {
            let entity = format!("{entity}: mimic");
            Some(Mimic {
                joint: text_of(&node, &entity, "joint")?,
                multiplier: one(&node, &entity, "multiplier", SHARE_MAX)?.unwrap_or(1.0),
                offset: one(&node, &entity, "offset", SHARE_MAX)?.unwrap_or(0.0),
            })
        }
        None => None,
    };
    let (range, velocity_max) = limits(node, &entity, &kind, child("limit"))?;
    let has_soft_limits = child("safety_controller").is_some();
    let span = head(node);
    Ok(UrdfJoint {
        name,
        span,
        kind,
        parent,
        child: child_link,
        origin,
        axis,
        range,
        velocity_max,
        mimic,
        has_soft_limits,
    })
}

type Limits = (Option<[f64; 2]>, Option<f64>);

fn limits(joint: &Node<'_, '_>, entity: &str, kind: &str, limit: Option<Node<'_, '_>>) -> Result<Limits, Located> {
    let entity = format!("{entity}: limit");
    let [most, fastest] = if kind == "prismatic" { [LENGTH_MAX, SLIDE_SPEED_MAX] } else { [TURN_MAX, TURN_SPEED_MAX] };
    let velocity_max = limit.map(|node| one(&node, &entity, "velocity", fastest)).transpose()?.flatten();
    if let Some(velocity) = velocity_max.filter(|velocity| *velocity < 0.0) {
        return Err(form(joint, entity, "a velocity that is not negative", &velocity.to_string()));
    }
    // Exporters write zero for "not known".
    let velocity_max = velocity_max.filter(|velocity| *velocity > 0.0);
    match (kind, limit) {
        ("continuous", _) => Ok((Some([f64::NEG_INFINITY, f64::INFINITY]), velocity_max)),
        ("revolute" | "prismatic", Some(node)) => {
            let end = |name| Ok(one(&node, &entity, name, most)?.unwrap_or(0.0));
            let [low, high] = [end("lower")?, end("upper")?];
            if low < high {
                return Ok((Some([low, high]), velocity_max));
            }
            Err(form(&node, entity, "lower below upper", &format!("{low} and {high}")))
        }
        _ => Ok((None, velocity_max)),
    }
}

/// A number of at most `most`, either way.
fn one(node: &Node<'_, '_>, entity: &str, attribute: &str, most: f64) -> Result<Option<f64>, Located> {
    let Some(text) = node.attribute(attribute) else { return Ok(None) };
    let fault = |expected: &str| form(node, format!("{entity}: {attribute}"), expected, text);
    let number: f64 =
        text.trim().parse().ok().filter(|n: &f64| n.is_finite()).ok_or_else(|| fault("a finite number"))?;
    if number.abs() > most {
        return Err(fault(&format!("a number from -{most:.1} to {most:.1}")));
    }
    Ok(Some(number))
}

/// Three numbers of at most `most`, either way.
fn three(
    node: &Node<'_, '_>,
    entity: &str,
    attribute: &str,
    default: [f64; 3],
    most: f64,
) -> Result<[f64; 3], Located> {
    let Some(text) = node.attribute(attribute) else { return Ok(default) };
    let fault = |expected: &str| form(node, format!("{entity}: {attribute}"), expected, text);
    let numbers: Option<Vec<f64>> =
        text.split_whitespace().map(|word| word.parse().ok().filter(|number: &f64| number.is_finite())).collect();
    let three = numbers.and_then(|numbers| <[f64; 3]>::try_from(numbers).ok());
    let three = three.ok_or_else(|| fault("three finite numbers"))?;
    if three.iter().any(|number| number.abs() > most) {
        return Err(fault(&format!("three numbers from -{most:.1} to {most:.1}")));
    }
    Ok(three)
}

impl Tree {
    /// Every joint joins links that exist, and every link has one parent at most and no circle above it.
    fn check(&self) -> Result<(), Located> {
        let fault = |joint: &UrdfJoint, link: &str, problem| {
            Err((joint.span.clone(), UrdfFault::Tree { link: link.to_owned(), problem }))
        };
        let known: BTreeSet<_> = self.links.iter().collect();
        if let Some(twice) =
            self.links.iter().enumerate().find_map(|(at, link)| self.links.iter().take(at).find(|other| *other == link))
        {
            let problem = "is there twice";
            return Err((self.span.clone(), UrdfFault::Tree { link: twice.clone(), problem }));
        }
        let (mut children, mut names) = (BTreeSet::new(), BTreeSet::new());
        for joint in &self.joints {
            if !names.insert(&joint.name) {
                let (entity, expected) = (format!("joint {}", joint.name), "a name of its own".to_owned());
                return Err((
                    joint.span.clone(),
                    UrdfFault::Form { entity, expected, found: "another of that name".to_owned() },
                ));
            }
            for link in [&joint.parent, &joint.child] {
                if !known.contains(link) {
                    return fault(joint, link, "is not in the file");
                }
            }
            if !children.insert(&joint.child) {
                return fault(joint, &joint.child, "has two parents");
            }
        }
        for joint in &self.joints {
            if self.to_root(&joint.child).is_none() {
                return fault(joint, &joint.child, "is its own ancestor");
            }
        }
        Ok(())
    }

    fn above(&self, link: &str) -> Option<&UrdfJoint> {
        self.joints.iter().find(|joint| joint.child == link)
    }

    /// The joints from a link up to its root; none when they go in a circle.
    fn to_root(&self, link: &str) -> Option<Vec<&UrdfJoint>> {
        let (mut path, mut link) = (Vec::new(), link);
        while let Some(joint) = self.above(link) {
            path.push(joint);
            link = &joint.parent;
            if path.len() > self.joints.len() {
                return None;
            }
        }
        Some(path)
    }

    /// Base and tip: as asked for, or the only ones possible: the root, and of the links at an end the one that the most joints
    /// move.
    pub fn ends(&self, ends: &Ends) -> Result<(String, String), Located> {
        let named = |name: &String| match self.links.contains(name) {
            true => Ok(name.clone()),
            false => Err((self.span.clone(), UrdfFault::NoSuchLink { name: name.clone(), known: self.links.clone() })),
        };
        let only = |end, candidates: Vec<String>| match <[String; 1]>::try_from(candidates) {
            Ok([link]) => Ok(link),
            Err(candidates) => Err((self.span.clone(), UrdfFault::Ambiguous { end, candidates })),
        };
        let base = match &ends.base {
            Some(base) => named(base)?,
            None => only("base link", self.links.iter().filter(|link| self.above(link).is_none()).cloned().collect())?,
        };
        let tip = match &ends.tip {
            Some(tip) => named(tip)?,
            None => {
                let moving =
                    |link: &str| self.to_root(link).unwrap_or_default().iter().filter(|joint| joint.moves()).count();
                let is_end = |link: &&String| !self.joints.iter().any(|joint| joint.parent == **link);
                let most = self.links.iter().map(|link| moving(link)).max().unwrap_or(0);
                only(
                    "tip link",
                    self.links.iter().filter(is_end).filter(|link| moving(link) == most).cloned().collect(),
                )?
            }
        };
        Ok((base, tip))
    }

    /// The joints from base to tip that move, each with its pose in the frame of the one before (or of the base), and the tip
    /// in the last one's.
    pub fn path(&self, base: &str, tip: &str) -> Result<Path<'_>, Located> {
        let (up, down) = (self.to_root(base).unwrap_or_default(), self.to_root(tip).unwrap_or_default());
        // Above their common ancestor both paths are the same.
        let shared = up.iter().rev().zip(down.iter().rev()).take_while(|(a, b)| a.name == b.name).count();
        let mut pending = Pose::identity();
        for joint in up.iter().take(up.len() - shared) {
            if joint.moves() {
                let fault = UrdfFault::MovingBase { base: base.to_owned(), joint: joint.name.clone() };
                return Err((joint.span.clone(), fault));
            }
            pending = pending * joint.origin.inverse();
        }
        let mut path = Vec::new();
        for joint in down.iter().take(down.len() - shared).rev() {
            pending = pending * joint.origin;
            if joint.moves() {
                path.push((std::mem::replace(&mut pending, Pose::identity()), *joint));
            }
        }
        Ok((path, pending))
    }

    /// The joint that a mimic joint follows, where that takes it beyond the range or the speed that the file gives itself.
    pub fn leads_beyond(&self, joint: &UrdfJoint) -> Option<&str> {
        /// What rounding of the file's figures does (rad, m).
        const ROUNDING: f64 = 1e-6;
        let Mimic { joint: driver, multiplier, offset } = joint.mimic.as_ref()?;
        let driver = self.joints.iter().find(|other| other.name == *driver)?;
        let leads = |end: f64| multiplier * end + offset;
        let is_beyond = joint.range.zip(driver.range).is_some_and(|([low, high], ends)| {
            ends.iter().any(|&end| !(low - ROUNDING <= leads(end) && leads(end) <= high + ROUNDING))
        });
        let speeds = joint.velocity_max.zip(driver.velocity_max);
        let is_fast = speeds.is_some_and(|(most, driver)| multiplier.abs() * driver > most + ROUNDING);
        (is_beyond || is_fast).then_some(&driver.name)
    }

    /// Whether a joint is on the way from base to tip.
    pub fn is_on(&self, joint: &UrdfJoint, base: &str, tip: &str) -> bool {
        self.path(base, tip).is_ok_and(|(path, _)| path.iter().any(|(_, on)| on.name == joint.name))
    }
}
