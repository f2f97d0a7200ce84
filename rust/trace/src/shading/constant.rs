//! Emission of shaders that are the same everywhere, as those of most lamps are.

use glam::{Vec3, Vec4};
use relume_scene::{BlendMode, Input, Material, MixData, Node, NodeId, Output};

use super::values::{NodeInputs, evaluate_pure};

/// The result of a node, or the number of a node behind it that varies.
type ConstantResult<T> = Result<T, NodeId>;

/// Emission of a shader as the only light of a lamp: nodes that scatter emit nothing. If it varies, the number of a
/// node that does.
pub fn constant_emission(material: &Material) -> ConstantResult<Vec3> {
    let mut values = ConstantValues(Vec::with_capacity(material.nodes.len()));
    let mut emissions: Vec<ConstantResult<Vec3>> = Vec::with_capacity(material.nodes.len());
    for (number, node) in material.nodes.iter().enumerate() {
        let number = number as NodeId;
        emissions.push(emission(node, number, &values, &emissions));
        let value = value(node, number, &values);
        values.0.push(value);
    }
    let none = Ok(Vec3::ZERO);
    material.surface.map_or(none, |surface| emissions.get(surface as usize).copied().unwrap_or(none))
}

/// Values of nodes so far.
struct ConstantValues(Vec<ConstantResult<Vec4>>);

impl ConstantValues {
    /// The number of a node that varies behind an input. `user` is the node that reads it.
    fn check(&self, input: &Input, user: NodeId) -> ConstantResult<()> {
        match input {
            Input::Link { node, .. } => self.0.get(*node as usize).unwrap_or(&Err(user)).map(|_| ()),
            _ => Ok(()),
        }
    }

    fn number(&self, input: &Input, user: NodeId) -> ConstantResult<f32> {
        self.check(input, user).map(|()| self.float(input))
    }
}

impl NodeInputs for ConstantValues {
    fn link(&self, node: NodeId, _output: Output) -> Vec4 {
        self.0.get(node as usize).and_then(|value| value.ok()).unwrap_or_default()
    }
}

fn value(node: &Node, number: NodeId, known: &ConstantValues) -> ConstantResult<Vec4> {
    let mut node = node.clone();
    forget_unused_side(&mut node, number, known);
    let mut inputs = Ok(());
    node.for_each_input(|input| inputs = inputs.and_then(|()| known.check(input, number)));
    inputs?;
    evaluate_pure(&node, known).ok_or(number)
}

/// Takes what a factor of 0 or 1 leaves out of a mixture.
fn forget_unused_side(node: &mut Node, number: NodeId, known: &ConstantValues) {
    let Node::Mix { data, blend, factor, a, b, .. } = node else { return };
    if *data == MixData::VectorNonUniform {
        return;
    }
    match known.number(factor, number) {
        Ok(0.0) => *b = Input::Float(0.0),
        Ok(1.0) if *blend == BlendMode::Mix => *a = Input::Float(0.0),
        _ => {}
    }
}

fn emission(
    node: &Node,
    number: NodeId,
    known: &ConstantValues,
    before: &[ConstantResult<Vec3>],
) -> ConstantResult<Vec3> {
    let child = |node: Option<NodeId>| match node {
        Some(node) => *before.get(node as usize).unwrap_or(&Err(number)),
        None => Ok(Vec3::ZERO),
    };
    match node {
        Node::Emission { color, strength } => match known.number(strength, number)? {
            0.0 => Ok(Vec3::ZERO),
            strength => known.check(color, number).map(|()| known.vector(color) * strength),
        },
        Node::MixShader { factor, a, b } => match known.number(factor, number)?.clamp(0.0, 1.0) {
            0.0 => child(*a),
            1.0 => child(*b),
            factor => Ok(child(*a)?.lerp(child(*b)?, factor)),
        },
        Node::AddShader { a, b } => Ok(child(*a)? + child(*b)?),
        Node::Principled { emission_strength: Input::Float(0.0), .. } => Ok(Vec3::ZERO),
        Node::Principled { .. } => Err(number),
        _ => Ok(Vec3::ZERO),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::{Value, json};

    fn emission_of(nodes: Value) -> ConstantResult<Vec3> {
        let surface = nodes.as_array().map(|nodes| nodes.len() - 1);
        let material = json!({"name": "Lamp", "nodes": nodes, "surface": surface});
        constant_emission(&serde_json::from_value(material).expect("a material"))
    }

    fn emitter(color: Value, strength: Value) -> Value {
        json!({"type": "emission", "color": color, "strength": strength})
    }

    fn double(of: Value) -> Value {
        json!({"type": "math", "operation": "ADD", "clamp": false, "a": of, "b": of, "c": 0.0})
    }

    #[test]
    fn constants_are_computed() {
        let twice = double(json!(1.5));
        let found = emission_of(json!([
            twice,
            emitter(json!([1.0, 0.5, 0.0]), json!({"node": 0, "output": "value"}))
        ]));
        assert_eq!(found, Ok(Vec3::new(3.0, 1.5, 0.0)));
    }

    #[test]
    fn shaders_are_mixed_and_added() {
        let (red, blue) =
            (emitter(json!([1.0, 0.0, 0.0]), json!(1.0)), emitter(json!([0.0, 0.0, 1.0]), json!(2.0)));
        let mix = json!({"type": "mix_shader", "factor": 0.25, "a": 0, "b": 1});
        let add = json!({"type": "add_shader", "a": 0, "b": 2});
        assert_eq!(emission_of(json!([red, blue, mix, add])), Ok(Vec3::new(1.75, 0.0, 0.5)));
        let glass = json!({"type": "transparent", "color": [1.0, 1.0, 1.0]});
        assert_eq!(emission_of(json!([glass])), Ok(Vec3::ZERO));
    }

    #[test]
    fn what_varies_is_named_unless_nothing_of_it_is_left() {
        let (geometry, position) = (json!({"type": "geometry"}), json!({"node": 0, "output": "position"}));
        let varied = emitter(position.clone(), json!(1.0));
        assert_eq!(emission_of(json!([geometry, varied])), Err(0));
        assert_eq!(emission_of(json!([geometry, emitter(position.clone(), json!(0.0))])), Ok(Vec3::ZERO));
        let mut mix = json!({"type": "mix", "data": "color", "blend": "MIX", "clamp_factor": true, "clamp_result": false,
                             "factor": 1.0, "a": position, "b": [0.5, 0.5, 0.5]});
        let shown = emitter(json!({"node": 1, "output": "color"}), json!(2.0));
        assert_eq!(emission_of(json!([geometry, mix, shown])), Ok(Vec3::ONE));
        mix["factor"] = json!(0.5);
        assert_eq!(emission_of(json!([geometry, mix, shown])), Err(0));
    }
}
