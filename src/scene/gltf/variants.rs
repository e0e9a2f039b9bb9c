//! Materials by the name of a variant (KHR_materials_variants).

use super::Outcome;
use super::json::Document;
use crate::scene::options::by_name;

/// The document's variants.
pub fn names(document: &Document) -> Vec<String> {
    document.extensions.variants.iter().flat_map(|list| &list.variants).map(|v| v.name.clone()).collect()
}

/// Gives each primitive the material of the variant that is asked for.
pub fn choose(document: &mut Document, wanted: Option<&str>) -> Outcome<()> {
    let Some(wanted) = wanted else { return Ok(()) };
    let names = names(document);
    let names: Vec<&str> = names.iter().map(String::as_str).collect();
    let variant = by_name(&names, wanted, "variant")?;
    for primitive in document.meshes.iter_mut().flat_map(|mesh| &mut mesh.primitives) {
        let mappings = primitive.extensions.variants.iter().flat_map(|variants| &variants.mappings);
        let mut of_variant = mappings.filter(|mapping| mapping.variants.iter().any(|v| v.0 == variant));
        if let Some(mapping) = of_variant.next() {
            primitive.material = Some(mapping.material);
        }
    }
    Ok(())
}
