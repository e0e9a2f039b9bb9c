//! Shaders with their bindings: set 0 holds storage buffers, everything else is push constants.
#![allow(unsafe_code)]

use std::ffi::CString;
use std::io::Cursor;
use std::sync::Arc;

use ash::vk;

use super::context::Context;
use crate::error::{Error, Result};

/// A compiled WGSL module and how its entry points are bound.
#[derive(Clone, Copy)]
pub struct Shader {
    /// The file's name, for messages.
    pub name: &'static str,
    /// SPIR-V.
    pub words: &'static [u8],
    /// Storage buffers of set 0, at bindings 0 and up.
    pub buffers: u32,
    /// Bytes of push constants.
    pub push: u32,
}

/// Layouts that pipelines of one shader use.
pub(super) struct Layout {
    context: Context,
    pub set: vk::DescriptorSetLayout,
    pub pipeline: vk::PipelineLayout,
    pub stages: vk::ShaderStageFlags,
    pub buffers: u32,
    pub push: u32,
}

impl Layout {
    /// `structure`: an acceleration structure is bound behind the buffers.
    fn new(
        context: &Context,
        shader: &Shader,
        stages: vk::ShaderStageFlags,
        structure: bool,
    ) -> Result<Self> {
        let device = &context.0.device;
        let of_buffer = |binding| (binding, vk::DescriptorType::STORAGE_BUFFER);
        let of_structure =
            structure.then_some((shader.buffers, vk::DescriptorType::ACCELERATION_STRUCTURE_KHR));
        let bindings: Vec<_> = (0..shader.buffers)
            .map(of_buffer)
            .chain(of_structure)
            .map(|(binding, kind)| {
                vk::DescriptorSetLayoutBinding::default()
                    .binding(binding)
                    .descriptor_type(kind)
                    .descriptor_count(1)
                    .stage_flags(stages)
            })
            .collect();
        let info = vk::DescriptorSetLayoutCreateInfo::default().bindings(&bindings);
        let push = [vk::PushConstantRange::default().stage_flags(stages).size(shader.push)];
        // SAFETY: the create infos are valid, and handles made are destroyed by the struct's drop.
        unsafe {
            let set = device
                .create_descriptor_set_layout(&info, None)
                .map_err(|code| context.refused("a descriptor set layout", code))?;
            let mut layout = Layout {
                context: context.clone(),
                set,
                pipeline: vk::PipelineLayout::null(),
                stages,
                buffers: shader.buffers,
                push: shader.push,
            };
            let sets = [set];
            let info = vk::PipelineLayoutCreateInfo::default().set_layouts(&sets).push_constant_ranges(&push);
            layout.pipeline = device
                .create_pipeline_layout(&info, None)
                .map_err(|code| context.refused("a pipeline layout", code))?;
            Ok(layout)
        }
    }
}

impl Drop for Layout {
    fn drop(&mut self) {
        // SAFETY: pipelines hold their layout, and commands their pipelines, until they are done.
        unsafe {
            self.context.0.device.destroy_pipeline_layout(self.pipeline, None);
            self.context.0.device.destroy_descriptor_set_layout(self.set, None);
        }
    }
}

/// A shader module, destroyed once its pipeline is made.
struct Module<'a> {
    context: &'a Context,
    handle: vk::ShaderModule,
}

impl<'a> Module<'a> {
    fn new(context: &'a Context, shader: &Shader) -> Result<Self> {
        let failed = |log: String| Error::Kernel {
            kernel: shader.name.to_string(),
            device: context.report().name.clone(),
            log,
        };
        let words =
            ash::util::read_spv(&mut Cursor::new(shader.words)).map_err(|error| failed(error.to_string()))?;
        let info = vk::ShaderModuleCreateInfo::default().code(&words);
        // SAFETY: the words are a module that the build has validated.
        let handle = unsafe { context.0.device.create_shader_module(&info, None) }
            .map_err(|code| failed(code.to_string()))?;
        Ok(Module { context, handle })
    }
}

impl Drop for Module<'_> {
    fn drop(&mut self) {
        // SAFETY: pipelines do not need their modules once they are made.
        unsafe { self.context.0.device.destroy_shader_module(self.handle, None) };
    }
}

pub(super) struct Pipeline {
    pub handle: vk::Pipeline,
    pub layout: Layout,
    pub pass: vk::RenderPass,
}

impl Drop for Pipeline {
    fn drop(&mut self) {
        // SAFETY: commands hold their pipelines until they are done; null handles are ignored.
        unsafe {
            self.layout.context.0.device.destroy_pipeline(self.handle, None);
            self.layout.context.0.device.destroy_render_pass(self.pass, None);
        }
    }
}

fn build_failed(context: &Context, shader: &Shader, entry: &str, code: vk::Result) -> Error {
    Error::Kernel {
        kernel: format!("{}:{entry}", shader.name),
        device: context.report().name.clone(),
        log: code.to_string(),
    }
}

/// A compute entry point.
#[derive(Clone)]
pub struct ComputePipeline(pub(super) Arc<Pipeline>);

/// A compute entry point that traces rays through an acceleration structure, at the binding behind its buffers.
#[derive(Clone)]
pub struct RayPipeline(pub(super) Arc<Pipeline>);

impl ComputePipeline {
    /// Builds an entry point.
    ///
    /// # Errors
    /// [`Error::Kernel`] if the driver cannot compile it.
    pub fn new(context: &Context, shader: &Shader, entry: &str) -> Result<Self> {
        Pipeline::compute(context, shader, entry, false).map(ComputePipeline)
    }
}

impl RayPipeline {
    /// Builds an entry point for a context that traces rays.
    ///
    /// # Errors
    /// [`Error::Kernel`] if the driver cannot compile it.
    ///
    /// # Panics
    /// If the context has no ray queries switched on.
    pub fn new(context: &Context, shader: &Shader, entry: &str) -> Result<Self> {
        assert!(context.traces_rays(), "{} has no ray queries switched on", context.report().name);
        Pipeline::compute(context, shader, entry, true).map(RayPipeline)
    }
}

impl Pipeline {
    fn compute(context: &Context, shader: &Shader, entry: &str, structure: bool) -> Result<Arc<Self>> {
        let mut pipeline = Pipeline {
            handle: vk::Pipeline::null(),
            layout: Layout::new(context, shader, vk::ShaderStageFlags::COMPUTE, structure)?,
            pass: vk::RenderPass::null(),
        };
        let module = Module::new(context, shader)?;
        let name = entry_name(entry);
        let stage = vk::PipelineShaderStageCreateInfo::default()
            .stage(vk::ShaderStageFlags::COMPUTE)
            .module(module.handle)
            .name(&name);
        let info = [vk::ComputePipelineCreateInfo::default().stage(stage).layout(pipeline.layout.pipeline)];
        // SAFETY: module, layout and name are valid and fit each other.
        let made =
            unsafe { context.0.device.create_compute_pipelines(vk::PipelineCache::null(), &info, None) };
        pipeline.handle = made.map_err(|(_, code)| build_failed(context, shader, entry, code))?[0];
        Ok(Arc::new(pipeline))
    }
}

fn entry_name(entry: &str) -> CString {
    CString::new(entry).unwrap_or_default()
}

/// What the pixels of a target are made of.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Attachments {
    /// The format of colours.
    pub color: vk::Format,
    /// The format of depths, where there are any.
    pub depth: Option<vk::Format>,
}

impl From<vk::Format> for Attachments {
    fn from(color: vk::Format) -> Self {
        Attachments { color, depth: None }
    }
}

/// A fragment entry point that is run for each pixel of a rectangle of a colour target.
#[derive(Clone)]
pub struct PassPipeline(pub(super) Arc<Pipeline>);

impl PassPipeline {
    /// Builds a vertex entry point that covers the target with three vertices, and a fragment entry
    /// point that writes location 0 of targets of these formats; where they have depths, the fragment's, or
    /// the vertices' where it has none, replaces what was there.
    ///
    /// # Errors
    /// [`Error::Kernel`] if the driver cannot compile them.
    pub fn new(
        context: &Context,
        shader: &Shader,
        vertex: &str,
        fragment: &str,
        attachments: impl Into<Attachments>,
    ) -> Result<Self> {
        let attachments = attachments.into();
        let stages = vk::ShaderStageFlags::FRAGMENT;
        let mut pipeline = Pipeline {
            handle: vk::Pipeline::null(),
            layout: Layout::new(context, shader, stages, false)?,
            pass: render_pass(context, attachments)?,
        };
        let module = Module::new(context, shader)?;
        let (vertex_name, fragment_name) = (entry_name(vertex), entry_name(fragment));
        let stage = |stage, name| {
            vk::PipelineShaderStageCreateInfo::default().stage(stage).module(module.handle).name(name)
        };
        let stages = [
            stage(vk::ShaderStageFlags::VERTEX, vertex_name.as_c_str()),
            stage(vk::ShaderStageFlags::FRAGMENT, fragment_name.as_c_str()),
        ];
        let vertices = vk::PipelineVertexInputStateCreateInfo::default();
        let assembly = vk::PipelineInputAssemblyStateCreateInfo::default()
            .topology(vk::PrimitiveTopology::TRIANGLE_LIST);
        let viewport = vk::PipelineViewportStateCreateInfo::default().viewport_count(1).scissor_count(1);
        let raster = vk::PipelineRasterizationStateCreateInfo::default().line_width(1.0);
        let samples = vk::PipelineMultisampleStateCreateInfo::default()
            .rasterization_samples(vk::SampleCountFlags::TYPE_1);
        let written =
            [vk::PipelineColorBlendAttachmentState::default()
                .color_write_mask(vk::ColorComponentFlags::RGBA)];
        let blend = vk::PipelineColorBlendStateCreateInfo::default().attachments(&written);
        // Ignored by passes without depths.
        let depth = vk::PipelineDepthStencilStateCreateInfo::default()
            .depth_test_enable(true)
            .depth_write_enable(true)
            .depth_compare_op(vk::CompareOp::ALWAYS);
        let states = [vk::DynamicState::VIEWPORT, vk::DynamicState::SCISSOR];
        let dynamic = vk::PipelineDynamicStateCreateInfo::default().dynamic_states(&states);
        let info = [vk::GraphicsPipelineCreateInfo::default()
            .stages(&stages)
            .vertex_input_state(&vertices)
            .input_assembly_state(&assembly)
            .viewport_state(&viewport)
            .rasterization_state(&raster)
            .multisample_state(&samples)
            .color_blend_state(&blend)
            .depth_stencil_state(&depth)
            .dynamic_state(&dynamic)
            .layout(pipeline.layout.pipeline)
            .render_pass(pipeline.pass)];
        // SAFETY: all that the info points to lives until the call returns.
        let made =
            unsafe { context.0.device.create_graphics_pipelines(vk::PipelineCache::null(), &info, None) };
        pipeline.handle = made.map_err(|(_, code)| build_failed(context, shader, fragment, code))?[0];
        Ok(PassPipeline(Arc::new(pipeline)))
    }
}

/// A pass that writes colours, and depths where there are any; pixels outside the render area are kept.
pub(super) fn render_pass(context: &Context, attachments: Attachments) -> Result<vk::RenderPass> {
    let attachment = |format, layout| {
        vk::AttachmentDescription::default()
            .format(format)
            .samples(vk::SampleCountFlags::TYPE_1)
            .load_op(vk::AttachmentLoadOp::DONT_CARE)
            .store_op(vk::AttachmentStoreOp::STORE)
            .stencil_load_op(vk::AttachmentLoadOp::DONT_CARE)
            .stencil_store_op(vk::AttachmentStoreOp::DONT_CARE)
            .initial_layout(layout)
            .final_layout(layout)
    };
    let reference = |index, layout| vk::AttachmentReference::default().attachment(index).layout(layout);
    let (color_layout, depth_layout) =
        (vk::ImageLayout::COLOR_ATTACHMENT_OPTIMAL, vk::ImageLayout::DEPTH_STENCIL_ATTACHMENT_OPTIMAL);
    let colors = [reference(0, color_layout)];
    let depths = reference(1, depth_layout);
    let mut subpass = vk::SubpassDescription::default()
        .pipeline_bind_point(vk::PipelineBindPoint::GRAPHICS)
        .color_attachments(&colors);
    if attachments.depth.is_some() {
        subpass = subpass.depth_stencil_attachment(&depths);
    }
    let subpasses = [subpass];
    let attachments: Vec<_> = [attachment(attachments.color, color_layout)]
        .into_iter()
        .chain(attachments.depth.map(|format| attachment(format, depth_layout)))
        .collect();
    let info = vk::RenderPassCreateInfo::default().attachments(&attachments).subpasses(&subpasses);
    // SAFETY: the arrays outlive the call.
    unsafe { context.0.device.create_render_pass(&info, None) }
        .map_err(|code| context.refused("a render pass", code))
}
