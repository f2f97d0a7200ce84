//! Files: bake folders, scenes, light sets.

pub(crate) mod base_layers;
pub(crate) mod checksum;
pub(crate) mod contents;
pub(crate) mod damage;
pub(crate) mod environment;
pub(crate) mod folder_lock;
pub(crate) mod inspect;
pub(crate) mod light_set;
pub(crate) mod names;
pub(crate) mod obj_scene;
pub(crate) mod proxies;
pub(crate) mod scene_file;
mod shot_files;
pub(crate) mod shot_list;
pub(crate) mod validate;
