//! Shader graphs made ready: constants folded, dead branches cut, and for each closure the list of value nodes that
//! must be evaluated on the way to it.

use std::collections::BTreeSet;

use glam::{Mat3, Vec3, Vec4};
use relume_scene::{Displacement, Input, Material, Node, NodeId, NormalSpace, Output, TangentKind};

use super::principled::Parameters;
use super::values::{NodeInputs, component, evaluate_pure};

/// Most closures that one graph may mix, shared ones counted as often as they are used.
const MAX_CLOSURE_VISITS: usize = 256;

/// A graph ready to run.
#[derive(Clone, Debug, Default)]
pub struct Graph {
    /// The material's nodes with constant inputs in place of links to constants.
    pub nodes: Vec<Node>,
    /// The root closure.
    pub surface: Option<NodeId>,
    /// The root closure of the medium.
    pub volume: Option<NodeId>,
    /// Shading normal in place of the mesh's.
    pub normal: Option<Normal>,
    /// Offset of vertices.
    pub displacement: Option<Offset>,
    /// For each closure node, the value nodes to evaluate before it, in order.
    pub needs: Vec<Vec<NodeId>>,
    /// Parts of a node that can be computed beforehand.
    pub aids: Vec<Aid>,
    /// True if light that leaves a body does so by another normal than the mesh's.
    pub bends_exits: bool,
}

/// Shading normal, world space.
#[derive(Clone, Debug)]
pub struct Normal {
    /// Value of the normal.
    pub input: Input,
    /// The value nodes that it depends on, in order.
    pub needs: Vec<NodeId>,
}

/// Offset of vertices, world space.
#[derive(Clone, Debug)]
pub struct Offset {
    /// Value of the offset.
    pub input: Input,
    /// The value nodes that it depends on, in order.
    pub needs: Vec<NodeId>,
    /// See [`relume_scene::Displacement::keeps_normals`].
    pub keeps_normals: bool,
}

/// Precomputed part of a node.
#[derive(Clone, Debug, Default)]
pub enum Aid {
    /// No aid.
    #[default]
    None,
    /// Rotation of a Mapping node with a constant one.
    Rotation(Mat3),
    /// Number of a named attribute, see [`Names`].
    Attribute(usize),
    /// The value nodes that a Bump node's height depends on, in order.
    Height(Vec<NodeId>),
    /// Parameters of a Principled node with constant ones.
    Parameters(Box<Parameters>),
    /// True if an Image Texture node's alpha is in use, so that its colour must not be multiplied by it.
    StraightColor,
    /// True if a procedural texture's colour is in use.
    Colored,
    /// Numbers of the attributes that a Principled Volume node takes colour, density and temperature from.
    Fields([Option<usize>; 3]),
}

/// Names of attributes that graphs ask for; meshes are searched for each once.
#[derive(Debug, Default)]
pub struct Names {
    /// UV maps; the empty name is the active one.
    pub uv_maps: Vec<String>,
    /// UV maps whose tangents are needed: indices into `uv_maps`.
    pub tangents: BTreeSet<usize>,
    /// Attributes; the empty name is the active colour.
    pub attributes: Vec<String>,
}

fn number_of(names: &mut Vec<String>, name: &str) -> usize {
    names.iter().position(|known| known == name).unwrap_or_else(|| {
        names.push(name.into());
        names.len() - 1
    })
}

impl Graph {
    /// Prepares `material`; links that do not point backwards are cut and named in the second value.
    pub fn new(material: &Material, names: &mut Names) -> (Self, Vec<String>) {
        let mut warnings = Vec::new();
        let mut nodes = material.nodes.clone();
        cut_forward_links(&mut nodes, &material.name, &mut warnings);
        fold_constants(&mut nodes);
        let bends_exits = nodes.iter().any(|node| match node {
            Node::Principled { subsurface, normal, .. } => subsurface.is_some() && normal.is_some(),
            Node::SubsurfaceScattering { normal, .. } => normal.is_some(),
            _ => false,
        });
        let [surface, volume] = [material.surface, material.volume]
            .map(|root| root.filter(|root| (*root as usize) < nodes.len()));
        let mut graph = Self {
            surface,
            volume,
            normal: None,
            displacement: None,
            needs: vec![Vec::new(); nodes.len()],
            aids: Vec::new(),
            bends_exits,
            nodes,
        };
        let mut too_many = |part: &str| {
            let words = format!("more than {MAX_CLOSURE_VISITS} shaders are mixed; its {part} is left out");
            warnings.push(format!("material '{}': {words}", material.name));
        };
        if surface.is_some_and(|root| graph.plan(root, &BTreeSet::new(), &mut 0).is_none()) {
            too_many("surface");
            graph.surface = None;
        }
        if volume.is_some_and(|root| graph.plan(root, &BTreeSet::new(), &mut 0).is_none()) {
            too_many("volume");
            graph.volume = None;
        }
        graph.normal = material.bumped_normal.map(|input| Normal { input, needs: graph.needed_by(&input) });
        graph.displacement = material.displacement.map(|Displacement { offset, keeps_normals }| Offset {
            input: offset,
            needs: graph.needed_by(&offset),
            keeps_normals,
        });
        graph.aids = (0..graph.nodes.len()).map(|node| graph.aid(node, names)).collect();
        (graph, warnings)
    }

    /// The value nodes that `input` depends on, in order.
    fn needed_by(&self, input: &Input) -> Vec<NodeId> {
        let mut found = BTreeSet::new();
        self.collect(input, &mut found);
        found.into_iter().collect()
    }

    /// The value nodes that `input` depends on, itself included.
    fn collect(&self, input: &Input, found: &mut BTreeSet<NodeId>) {
        let mut open = vec![*input];
        while let Some(input) = open.pop() {
            if let Input::Link { node, .. } = input
                && found.insert(node)
            {
                open.extend(inputs_of(&self.nodes[node as usize]));
            }
        }
    }

    /// The value nodes that a closure and those below it depend on.
    fn collect_below(&self, closure: NodeId) -> BTreeSet<NodeId> {
        let mut found = BTreeSet::new();
        let mut seen = BTreeSet::from([closure]);
        let mut open = vec![closure];
        while let Some(closure) = open.pop() {
            let node = &self.nodes[closure as usize];
            for input in inputs_of(node) {
                self.collect(&input, &mut found);
            }
            open.extend(children_of(node).into_iter().flatten().filter(|child| seen.insert(*child)));
        }
        found
    }

    /// Decides at which closure each value node is evaluated: where it is used, or where the two sides of a mix that
    /// both use it part. `available` are those evaluated on the way. Nothing if there are too many.
    fn plan(&mut self, closure: NodeId, available: &BTreeSet<NodeId>, visits: &mut usize) -> Option<()> {
        *visits += 1;
        if *visits > MAX_CLOSURE_VISITS {
            return None;
        }
        let node = &self.nodes[closure as usize];
        let mut own = BTreeSet::new();
        for input in inputs_of(node) {
            self.collect(&input, &mut own);
        }
        let children = children_of(node);
        if let [Some(a), Some(b)] = children {
            let (below_a, below_b) = (self.collect_below(a), self.collect_below(b));
            own.extend(below_a.intersection(&below_b));
        }
        let mut needs: BTreeSet<NodeId> = own.difference(available).copied().collect();
        // A closure that is reached in two ways evaluates what either way lacks.
        needs.extend(&self.needs[closure as usize]);
        self.needs[closure as usize] = needs.into_iter().collect();
        let available: BTreeSet<NodeId> = available.union(&own).copied().collect();
        for child in children.into_iter().flatten() {
            self.plan(child, &available, visits)?;
        }
        Some(())
    }

    /// The nodes that the medium is made of.
    fn medium_nodes(&self) -> BTreeSet<NodeId> {
        let mut nodes = BTreeSet::new();
        let mut open: Vec<NodeId> = self.volume.into_iter().collect();
        while let Some(closure) = open.pop() {
            if nodes.insert(closure) {
                open.extend(children_of(&self.nodes[closure as usize]).into_iter().flatten());
            }
        }
        nodes.extend(self.volume.map(|root| self.collect_below(root)).unwrap_or_default());
        nodes
    }

    /// True if the medium may differ from place to place within an object that has no fields.
    pub fn medium_varies(&self) -> bool {
        let is_same_everywhere = |node: &Node| match node {
            Node::ObjectInfo | Node::LightPath | Node::Attribute { .. } | Node::ColorAttribute { .. } => true,
            closure if is_medium_closure(closure) => true,
            value => evaluate_pure(value, &NoLinks).is_some(),
        };
        self.medium_nodes().into_iter().any(|node| !is_same_everywhere(&self.nodes[node as usize]))
    }

    /// True if the medium asks for the kind or depth of rays.
    pub fn medium_asks_light_path(&self) -> bool {
        self.medium_nodes().into_iter().any(|node| matches!(self.nodes[node as usize], Node::LightPath))
    }

    /// True if the medium is computed from what it reads, other than by closures.
    pub fn medium_computes(&self) -> bool {
        let is_read = |node: &Node| matches!(node, Node::Attribute { .. } | Node::ColorAttribute { .. });
        let computes = |node: &Node| !is_read(node) && !is_medium_closure(node);
        self.medium_nodes().into_iter().any(|node| computes(&self.nodes[node as usize]))
    }

    /// Numbers of the attributes that the medium reads, see [`Names::attributes`].
    pub fn medium_fields(&self) -> Vec<usize> {
        let fields = |node: NodeId| match (&self.nodes[node as usize], &self.aids[node as usize]) {
            (_, Aid::Fields(names)) => names.iter().copied().flatten().collect(),
            (Node::Attribute { .. } | Node::ColorAttribute { .. }, Aid::Attribute(name)) => vec![*name],
            _ => Vec::new(),
        };
        self.medium_nodes().into_iter().flat_map(fields).collect()
    }

    /// True if the medium may glow.
    pub fn medium_glows(&self) -> bool {
        let is_zero = |input: &Input| matches!(input, Input::Float(0.0) | Input::Rgb([0.0, 0.0, 0.0]));
        self.medium_nodes().into_iter().any(|node| match &self.nodes[node as usize] {
            Node::Emission { color, strength } => !is_zero(color) && !is_zero(strength),
            Node::VolumeCoefficients { emission, .. } => !is_zero(emission),
            Node::PrincipledVolume { emission_color, emission_strength, blackbody, .. } => {
                blackbody.is_some() || (!is_zero(emission_color) && !is_zero(emission_strength))
            }
            _ => false,
        })
    }

    fn aid(&self, node: usize, names: &mut Names) -> Aid {
        match &self.nodes[node] {
            Node::Mapping { rotation: Input::Rgb(angles), .. } => {
                Aid::Rotation(rotation(Vec3::from(*angles)))
            }
            Node::Mapping { rotation: Input::Float(angle), .. } => {
                Aid::Rotation(rotation(Vec3::splat(*angle)))
            }
            principled @ Node::Principled { .. } if has_constant_parameters(principled) => {
                Parameters::read(principled, &NoLinks)
                    .map_or(Aid::None, |read| Aid::Parameters(Box::new(read)))
            }
            Node::UvMap { name } => Aid::Attribute(number_of(&mut names.uv_maps, name)),
            Node::ColorAttribute { name } | Node::Attribute { name } => {
                Aid::Attribute(number_of(&mut names.attributes, name))
            }
            Node::PrincipledVolume { color_attribute, density_attribute, temperature_attribute, .. } => {
                let mut number =
                    |name: &String| (!name.is_empty()).then(|| number_of(&mut names.attributes, name));
                let [color, density, temperature] =
                    [number(color_attribute), number(density_attribute), number(temperature_attribute)];
                Aid::Fields([color, density, temperature])
            }
            Node::NormalMap { uv_map, .. } => {
                let number = number_of(&mut names.uv_maps, uv_map);
                names.tangents.insert(number);
                Aid::Attribute(number)
            }
            Node::Tangent { kind: TangentKind::UvMap, uv_map } => {
                let number = number_of(&mut names.uv_maps, uv_map);
                names.tangents.insert(number);
                Aid::Attribute(number)
            }
            Node::VectorDisplacement { space: NormalSpace::Tangent, .. } => {
                let number = number_of(&mut names.uv_maps, "");
                names.tangents.insert(number);
                Aid::Attribute(number)
            }
            Node::Bump { height, .. } => Aid::Height(self.needed_by(height)),
            Node::ImageTexture { .. } if self.is_used(node as NodeId, Output::Alpha) => Aid::StraightColor,
            Node::Procedural(_) if self.is_used(node as NodeId, Output::Color) => Aid::Colored,
            _ => Aid::None,
        }
    }

    fn is_used(&self, wanted: NodeId, wanted_output: Output) -> bool {
        self.nodes.iter().any(|node| {
            inputs_of(node).iter().any(|input| {
                matches!(input, Input::Link { node, output } if *node == wanted && *output == wanted_output)
            })
        })
    }
}

/// Blender's XYZ Euler rotation.
pub fn rotation(angles: Vec3) -> Mat3 {
    Mat3::from_rotation_z(angles.z) * Mat3::from_rotation_y(angles.y) * Mat3::from_rotation_x(angles.x)
}

/// True if no input but for the directions is linked.
fn has_constant_parameters(node: &Node) -> bool {
    let mut node = node.clone();
    if let Node::Principled { normal, coat_normal, tangent, .. } = &mut node {
        (*normal, *coat_normal, *tangent) = (None, None, None);
    }
    !inputs_of(&node).iter().any(|input| matches!(input, Input::Link { .. }))
}

fn inputs_of(node: &Node) -> Vec<Input> {
    let mut inputs = Vec::new();
    node.clone().for_each_input(|input| inputs.push(*input));
    inputs
}

fn children_of(node: &Node) -> [Option<NodeId>; 2] {
    match node {
        Node::MixShader { factor: Input::Float(factor), a, .. } if *factor <= 0.0 => [*a, None],
        Node::MixShader { factor: Input::Float(factor), b, .. } if *factor >= 1.0 => [None, *b],
        Node::MixShader { a, b, .. } | Node::AddShader { a, b } => [*a, *b],
        _ => [None, None],
    }
}

fn is_medium_closure(node: &Node) -> bool {
    matches!(
        node,
        Node::MixShader { .. }
            | Node::AddShader { .. }
            | Node::Emission { .. }
            | Node::VolumeScatter { .. }
            | Node::VolumeAbsorption { .. }
            | Node::VolumeCoefficients { .. }
            | Node::PrincipledVolume { .. }
    )
}

fn cut_forward_links(nodes: &mut [Node], material: &str, warnings: &mut Vec<String>) {
    for (index, node) in nodes.iter_mut().enumerate() {
        let mut is_cut = false;
        node.for_each_input(|input| {
            if matches!(input, Input::Link { node, .. } if *node as usize >= index) {
                *input = Input::Float(0.0);
                is_cut = true;
            }
        });
        if let Node::MixShader { a, b, .. } | Node::AddShader { a, b } = node {
            for child in [a, b] {
                if child.is_some_and(|child| child as usize >= index) {
                    *child = None;
                    is_cut = true;
                }
            }
        }
        if is_cut {
            warnings.push(format!(
                "material '{material}': node {index} refers to a later node; export it in topological order"
            ));
        }
    }
}

/// Replaces links to nodes whose inputs are all constant by their values.
fn fold_constants(nodes: &mut [Node]) {
    let mut constants: Vec<Option<Vec4>> = vec![None; nodes.len()];
    for index in 0..nodes.len() {
        let mut is_constant = true;
        nodes[index].for_each_input(|input| {
            if let Input::Link { node, output } = input {
                match constants[*node as usize].and_then(|value| constant(value, *output)) {
                    Some(value) => *input = value,
                    None => is_constant = false,
                }
            }
        });
        if is_constant {
            constants[index] = evaluate_pure(&nodes[index], &NoLinks);
        } else if is_mapped_to_zero(&nodes[index]) {
            constants[index] = Some(Vec4::ZERO);
        }
    }
}

/// True for a Mapping node of scale 0 with links, which Cycles takes for 0 whatever its location is
/// (`ConstantFolder::fold_mapping`); where all inputs are constant it computes them.
fn is_mapped_to_zero(node: &Node) -> bool {
    match node {
        Node::Mapping { scale: Input::Rgb(scale), .. } => *scale == [0.0; 3],
        Node::Mapping { scale: Input::Float(scale), .. } => *scale == 0.0,
        _ => false,
    }
}

/// The value of an output as a constant input. Vectors are left to be evaluated, since a constant does not remember
/// that its conversion to a float is the mean and not the luminance.
fn constant(value: Vec4, output: Output) -> Option<Input> {
    match output {
        Output::Vector if value.truncate() == Vec3::ZERO => Some(Input::Float(0.0)),
        Output::Vector | Output::Normal => None,
        Output::Color => Some(Input::Rgb(value.truncate().to_array())),
        _ => component(value, output).map(Input::Float),
    }
}

struct NoLinks;

impl NodeInputs for NoLinks {
    fn link(&self, _node: NodeId, _output: Output) -> Vec4 {
        Vec4::ZERO
    }
}
