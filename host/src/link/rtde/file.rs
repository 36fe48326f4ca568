//! The recipes of a client, from the XML file that Universal Robots' own clients read: `<rtde_config>` holds
//! `<recipe key="...">`, each of `<field name="..." type="..."/>`.
//!
//! A recipe whose fields can all be written is one of inputs, another is one of outputs. Names and types are held against the
//! guide's table. A name that is not in it is left to the controller, which may be newer than the table: then the file's type
//! counts.

use super::fields;
use super::recipe::{Field, FieldName};
use super::wire::FieldType;
use crate::failure::{Excerpt, Exit, Failure};
use roxmltree::{Document, Node, ParsingOptions};
use std::ops::Range;
use std::path::{Path, PathBuf};

#[cfg(test)]
mod tests;

/// The recipes of one file.
#[derive(Clone, Debug, PartialEq)]
pub struct RecipeFile {
    /// The file's name, for messages.
    pub name: String,
    /// In its order; no two with the same key.
    pub recipes: Vec<Recipe>,
}

/// One recipe.
#[derive(Clone, Debug, PartialEq)]
pub struct Recipe {
    /// Its key.
    pub key: String,
    /// Whether a client writes it; else it reads it.
    pub is_input: bool,
    /// At least one, none twice.
    pub fields: Vec<Field>,
}

/// What is wrong with a recipe file.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum FileFault {
    /// No XML.
    #[error("this is not XML: {message}")]
    Xml {
        /// What the reader said.
        message: String,
    },
    /// Something else than what belongs there.
    #[error("{entity}: expected {expected}, found {found}")]
    Form {
        /// Where in the file's structure.
        entity: String,
        /// What should stand there.
        expected: String,
        /// What stands there.
        found: String,
    },
    /// A type that is not the field's.
    #[error("recipe {recipe}, field {field}: expected type {expected}, found {found}")]
    WrongType {
        /// The recipe's key.
        recipe: String,
        /// The field's name.
        field: String,
        /// By the guide; all types for a field that is not in it.
        expected: String,
        /// By the file.
        found: String,
    },
    /// What is read and what is written in one recipe.
    #[error("recipe {recipe}, field {field}: expected an input, as the recipe's {input} is one, found an output")]
    Mixed {
        /// The recipe's key.
        recipe: String,
        /// The field's name.
        field: String,
        /// The input beside it.
        input: String,
    },
    /// The same again.
    #[error("{entity} stands here for the second time: expected once")]
    Twice {
        /// What.
        entity: String,
    },
}

impl FileFault {
    const fn remedy(&self) -> &'static str {
        match self {
            Self::Xml { .. } | Self::Form { .. } => "docs/rtde.md shows a whole file",
            Self::WrongType { .. } => "write the expected type; the RTDE guide lists every field",
            Self::Mixed { .. } => "make two recipes of it",
            Self::Twice { .. } => "leave one of them out",
        }
    }
}

/// Why there are no recipes.
#[derive(Debug, thiserror::Error)]
pub enum FileError {
    /// The file cannot be read.
    #[error("cannot read the recipes {}: {source}", file.display())]
    Read {
        /// The file.
        file: PathBuf,
        /// What the system said.
        source: std::io::Error,
    },
    /// Its bytes are no UTF-8.
    #[error("{}: expected text in UTF-8, found {found}", file.display())]
    Encoding {
        /// The file.
        file: PathBuf,
        /// What its bytes are.
        found: String,
    },
    /// Something in it is wrong.
    #[error("{}:{}:{}: {fault}", place.file, place.line, place.column)]
    Invalid {
        /// Where.
        place: Box<Excerpt>,
        /// What.
        fault: FileFault,
    },
}

impl From<FileError> for Failure {
    fn from(error: FileError) -> Self {
        match error {
            FileError::Read { .. } => {
                Self::new(Exit::Input, error.to_string(), "check the path and that the file may be read")
            }
            FileError::Encoding { .. } => Self::new(
                Exit::Input,
                error.to_string(),
                "save it as UTF-8 in an editor, and say encoding=\"UTF-8\" or none in its first line",
            ),
            FileError::Invalid { place, fault } => Self::new(Exit::Input, fault.to_string(), fault.remedy()).at(*place),
        }
    }
}

type Located = (Range<usize>, FileFault);

/// Reads a file.
///
/// # Errors
/// [`FileError`].
pub fn load(path: &Path) -> Result<RecipeFile, FileError> {
    let bytes = std::fs::read(path).map_err(|source| FileError::Read { file: path.to_owned(), source })?;
    let text = utf8(&bytes).map_err(|found| FileError::Encoding { file: path.to_owned(), found })?;
    parse(&path.to_string_lossy(), text)
}

/// The text, without a mark of its byte order; or what the bytes are instead.
fn utf8(bytes: &[u8]) -> Result<&str, String> {
    if matches!(bytes, [0xff, 0xfe, ..] | [0xfe, 0xff, ..] | [b'<', 0, ..] | [0, b'<', ..]) {
        return Err("UTF-16".to_owned());
    }
    let text = std::str::from_utf8(bytes).map_err(|error| {
        let line = bytes.iter().take(error.valid_up_to()).filter(|byte| **byte == b'\n').count() + 1;
        format!("other bytes in line {line}")
    })?;
    Ok(text.strip_prefix('\u{feff}').unwrap_or(text))
}

/// Reads the text of a file; `name` is the file's name for messages.
///
/// # Errors
/// [`FileError::Invalid`].
pub fn parse(name: &str, text: &str) -> Result<RecipeFile, FileError> {
    let recipes = read(text).map_err(|(span, fault)| FileError::Invalid {
        place: Excerpt::new(name, text.as_bytes(), span).into(),
        fault,
    })?;
    Ok(RecipeFile { name: name.to_owned(), recipes })
}

impl RecipeFile {
    /// The recipe with this key.
    pub fn recipe(&self, key: &str) -> Option<&Recipe> {
        self.recipes.iter().find(|recipe| recipe.key == key)
    }

    /// The recipe of the field on this line.
    pub fn recipe_at(&self, line: u32) -> Option<&Recipe> {
        self.recipes.iter().find(|recipe| recipe.fields.iter().any(|field| field.line == line))
    }

    /// The fields of all recipes of outputs.
    pub fn outputs(&self) -> impl Iterator<Item = &Field> {
        self.recipes.iter().filter(|recipe| !recipe.is_input).flat_map(|recipe| &recipe.fields)
    }

    /// The register offsets, 0 or 24, at which the recipes of inputs have what Screed writes: six double registers and an
    /// integer register, each from the offset on. `None` when they have neither double nor integer registers.
    pub fn register_offsets(&self) -> Option<Vec<u8>> {
        let fields = || self.recipes.iter().filter(|recipe| recipe.is_input).flat_map(|recipe| &recipe.fields);
        let has = |name: &str| fields().any(|field| field.name.as_bytes() == name.as_bytes());
        let is_complete = |first: u8| {
            let doubles = (first..first + 6).all(|register| has(&format!("input_double_register_{register}")));
            doubles && has(&format!("input_int_register_{first}"))
        };
        let is_register = |field: &Field| {
            let name = field.name.as_bytes();
            name.starts_with(b"input_double_register_") || name.starts_with(b"input_int_register_")
        };
        fields().any(is_register).then(|| [0, 24].into_iter().filter(|first| is_complete(*first)).collect())
    }
}

fn read(text: &str) -> Result<Vec<Recipe>, Located> {
    let options = ParsingOptions { allow_dtd: false, ..ParsingOptions::default() };
    let document = Document::parse_with_options(text, options).map_err(|error| {
        let at = error.pos();
        let line: usize = text.split_inclusive('\n').take(at.row.saturating_sub(1) as usize).map(str::len).sum();
        let start = line + at.col.saturating_sub(1) as usize;
        (start..start + 1, FileFault::Xml { message: error.to_string() })
    })?;
    let root = document.root_element();
    if root.tag_name().name() != "rtde_config" {
        return Err(form(&root, "the file", "an element rtde_config", root.tag_name().name()));
    }
    let mut recipes: Vec<Recipe> = Vec::new();
    for node in elements(&root, "recipe", &[], "rtde_config")? {
        let recipe = recipe(&node)?;
        if recipes.iter().any(|known| known.key == recipe.key) {
            return Err((head(&node), FileFault::Twice { entity: format!("recipe {}", recipe.key) }));
        }
        recipes.push(recipe);
    }
    match recipes.is_empty() {
        true => Err(form(&root, "rtde_config", "at least one recipe", "none")),
        false => Ok(recipes),
    }
}

fn recipe(node: &Node<'_, '_>) -> Result<Recipe, Located> {
    let key = attribute(node, "recipe", "key")?.to_owned();
    let entity = format!("recipe {key}");
    let mut nodes: Vec<(&str, FieldName, Node<'_, '_>)> = Vec::new();
    for node in elements(node, "field", &["key"], &entity)? {
        let name = attribute(&node, &entity, "name")?;
        let is_plain = name.bytes().all(|byte| byte.is_ascii_alphanumeric() || byte == b'_');
        let Some(short) = FieldName::new(name.as_bytes()).filter(|_| is_plain) else {
            return Err(form(&node, &entity, "a name of at most 48 letters, digits and underscores", name));
        };
        if nodes.iter().any(|(known, ..)| *known == name) {
            return Err((head(&node), FileFault::Twice { entity: format!("{entity}, field {name}") }));
        }
        elements(&node, "", &["name", "type"], &format!("{entity}, field {name}"))?;
        nodes.push((name, short, node));
    }
    let Some((first, ..)) = nodes.first() else {
        return Err(form(node, &entity, "at least one field", "none"));
    };
    // What can only be written makes the recipe one of inputs; what can be written and read does not make it one of outputs.
    let only_input = nodes.iter().find(|(name, ..)| fields::input(name).is_some() && fields::output(name).is_none());
    let is_input = only_input.is_some() || nodes.iter().all(|(name, ..)| fields::input(name).is_some());
    let input = only_input.map_or(*first, |(name, ..)| *name).to_owned();
    let mut read = Vec::new();
    for (name, short, node) in &nodes {
        let known = if is_input { fields::input(name) } else { fields::output(name) };
        if is_input && known.is_none() {
            let fault = FileFault::Mixed { recipe: key, field: (*name).to_owned(), input };
            return Err((head(node), fault));
        }
        let found = attribute(node, &format!("{entity}, field {name}"), "type")?;
        let kind = FieldType::from_name(found.as_bytes()).filter(|kind| known.is_none_or(|known| known == *kind));
        let Some(kind) = kind else {
            let expected = known.map_or_else(FieldType::names, |kind| kind.name().to_owned());
            let (field, found) = ((*name).to_owned(), found.to_owned());
            return Err((head(node), FileFault::WrongType { recipe: key, field, expected, found }));
        };
        read.push(Field { name: *short, kind, line: node.document().text_pos_at(node.range().start).row });
    }
    Ok(Recipe { key, is_input, fields: read })
}

/// The elements in a node, all of one name; there is no text beside them, and no attribute but those that are read.
fn elements<'a, 'i>(
    node: &Node<'a, 'i>,
    name: &str,
    attributes: &[&str],
    entity: &str,
) -> Result<Vec<Node<'a, 'i>>, Located> {
    if let Some(found) = node.attributes().find(|found| !attributes.contains(&found.name())) {
        let expected =
            if attributes.is_empty() { "no attribute".to_owned() } else { attributes.join(" and ") + " alone" };
        return Err(form(node, entity, &expected, &format!("attribute {}", found.name())));
    }
    let mut elements = Vec::new();
    for child in node.children() {
        let expected = || if name.is_empty() { "nothing in it".to_owned() } else { format!("elements {name}") };
        match child.text().map(str::trim).filter(|text| child.is_text() && !text.is_empty()) {
            Some(text) => return Err((child.range(), fault(entity, &expected(), &format!("the text {text:?}")))),
            None if child.is_element() && child.tag_name().name() == name => elements.push(child),
            None if child.is_element() => {
                return Err(form(&child, entity, &expected(), &format!("an element {}", child.tag_name().name())));
            }
            None => {}
        }
    }
    Ok(elements)
}

fn attribute<'a>(node: &Node<'a, '_>, entity: &str, name: &str) -> Result<&'a str, Located> {
    let found = node.attribute(name).filter(|value| !value.is_empty());
    found.ok_or_else(|| form(node, entity, &format!("an attribute {name}"), "none"))
}

fn form(node: &Node<'_, '_>, entity: &str, expected: &str, found: &str) -> Located {
    (head(node), fault(entity, expected, found))
}

fn fault(entity: &str, expected: &str, found: &str) -> FileFault {
    FileFault::Form { entity: entity.to_owned(), expected: expected.to_owned(), found: found.to_owned() }
}

/// The start tag of an element.
fn head(node: &Node<'_, '_>) -> Range<usize> {
    let range = node.range();
    let text = node.document().input_text().get(range.clone()).unwrap_or("");
    range.start..range.start + text.find('>').map_or(text.len(), |end| end + 1)
}
