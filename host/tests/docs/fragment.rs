//! Parts of descriptions that pages show: their keys are those of the schema.

use serde_json::Value;

/// Keys of a part of a description, or of a layout file, that `schema` does not have.
pub fn unknown_keys(part: &toml::Table, schema: &Value) -> Vec<String> {
    let part = toml::Value::Table(part.clone());
    let layout = &schema["properties"]["recording"];
    let [of_machine, of_layout] = [schema, layout].map(|of| unknown(&part, of, schema, ""));
    if of_layout.is_empty() {
        of_layout
    } else {
        of_machine
    }
}

fn unknown(part: &toml::Value, schema: &Value, root: &Value, at: &str) -> Vec<String> {
    if let Some(reference) = schema["$ref"].as_str() {
        let pointer = reference.trim_start_matches('#');
        return unknown(part, root.pointer(pointer).expect("a definition"), root, at);
    }
    for either in ["anyOf", "oneOf"] {
        if let Some(options) = schema[either].as_array() {
            // Null has no keys, and fits no part.
            let of_each = (options.iter())
                .filter(|option| option["type"] != "null")
                .map(|option| unknown(part, option, root, at));
            return of_each.min_by_key(Vec::len).unwrap_or_default();
        }
    }
    match part {
        toml::Value::Table(table) => (table.iter())
            .flat_map(|(key, value)| {
                let place = format!("{at}.{key}");
                let properties = &schema["properties"];
                let of_key = [&properties[key], &schema["additionalProperties"]]
                    .into_iter()
                    .find(|schema| schema.is_object());
                match of_key {
                    Some(schema) => unknown(value, schema, root, &place),
                    None => vec![place],
                }
            })
            .collect(),
        toml::Value::Array(items) => (items.iter())
            .flat_map(|item| match &schema["items"] {
                Value::Object(_) => unknown(item, &schema["items"], root, at),
                _ => Vec::new(),
            })
            .collect(),
        _ => Vec::new(),
    }
}

#[test]
fn a_key_that_the_schema_does_not_have_is_found() {
    let schema = crate::schema();
    let unknown = |text: &str| unknown_keys(&text.parse().unwrap(), &schema);
    assert_eq!(
        unknown("[[channel]]\nname = \"a\"\nlsb = 1"),
        [".channel.lsb"]
    );
    assert_eq!(
        unknown("[[channel]]\nadc = { lbs = 1 }"),
        [".channel.adc.lbs"]
    );
    assert!(unknown("[[channel]]\nadc = { lsb = 1 }").is_empty());
    assert!(unknown("delimiter = \",\"\n[channels]\nt = { unit = \"s\" }").is_empty());
}
