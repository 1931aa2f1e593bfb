//! Descriptor sets and pipelines.

use std::ffi::CString;
use std::sync::Arc;

use ash::vk;
use esvo_core::CastError;

use crate::buffers::Buffer;
use crate::data::Data;
use crate::gpu::Gpu;
use crate::spirv;
use crate::texture::Texture;

/// A descriptor set and its layout: binding `i` is the `i`-th buffer or texture.
pub(crate) struct BufferSet {
    pub(crate) layout: vk::DescriptorSetLayout,
    pub(crate) handle: vk::DescriptorSet,
    pool: vk::DescriptorPool,
    gpu: Arc<Gpu>,
}

/// What is at a binding.
enum Bound {
    Buffer(vk::DescriptorType, [vk::DescriptorBufferInfo; 1]),
    /// One that is read.
    Texture([vk::DescriptorImageInfo; 1]),
}

impl Bound {
    fn buffer(kind: vk::DescriptorType, buffer: &Buffer) -> Self {
        Self::Buffer(kind, [vk::DescriptorBufferInfo { buffer: buffer.handle, offset: 0, range: vk::WHOLE_SIZE }])
    }

    fn texture(texture: &Texture) -> Self {
        let info = vk::DescriptorImageInfo::default();
        Self::Texture([info.image_view(texture.view).image_layout(vk::ImageLayout::GENERAL)])
    }

    fn write(&self) -> vk::WriteDescriptorSet<'_> {
        let write = vk::WriteDescriptorSet::default();
        match self {
            Self::Buffer(kind, info) => write.descriptor_type(*kind).buffer_info(info),
            Self::Texture(info) => write.descriptor_type(vk::DescriptorType::STORAGE_IMAGE).image_info(info),
        }
    }
}

impl BufferSet {
    /// Binds whole buffers. They must live as long as the set is used.
    pub(crate) fn new(gpu: &Arc<Gpu>, buffers: &[(vk::DescriptorType, &Buffer)]) -> Result<Self, CastError> {
        Self::of(gpu, buffers.iter().map(|&(kind, buffer)| Bound::buffer(kind, buffer)).collect())
    }

    /// Binds what is read, one behind the other. It must live as long as the set is used.
    pub(crate) fn of_data(gpu: &Arc<Gpu>, data: &[&Data]) -> Result<Self, CastError> {
        let mut bound = Vec::new();
        for data in data {
            match data {
                Data::Buffers(buffers) => {
                    bound.extend(buffers.iter().map(|b| Bound::buffer(vk::DescriptorType::STORAGE_BUFFER, b)));
                }
                Data::Texture(texture) => bound.push(Bound::texture(texture)),
            }
        }
        Self::of(gpu, bound)
    }

    fn of(gpu: &Arc<Gpu>, bound: Vec<Bound>) -> Result<Self, CastError> {
        let mut set = Self {
            layout: vk::DescriptorSetLayout::null(),
            handle: vk::DescriptorSet::null(),
            pool: vk::DescriptorPool::null(),
            gpu: gpu.clone(),
        };
        set.make(bound.iter().map(Bound::write).collect()).map_err(|error| gpu.error(&error))?;
        Ok(set)
    }

    /// Makes the objects. `writes` say what each binding is.
    fn make(&mut self, writes: Vec<vk::WriteDescriptorSet<'_>>) -> Result<(), vk::Result> {
        let bindings: Vec<_> = (0..)
            .zip(&writes)
            .map(|(binding, write)| {
                vk::DescriptorSetLayoutBinding::default()
                    .binding(binding)
                    .descriptor_type(write.descriptor_type)
                    .descriptor_count(1)
                    .stage_flags(vk::ShaderStageFlags::COMPUTE)
            })
            .collect();
        let sizes: Vec<_> = (writes.iter())
            .map(|write| vk::DescriptorPoolSize { ty: write.descriptor_type, descriptor_count: 1 })
            .collect();
        let device = &self.gpu.device;
        // SAFETY: the buffers and textures are of this device; `drop` destroys every object, also if a later step fails; the set is
        // new, so nothing uses it while it is written.
        unsafe {
            let layout = vk::DescriptorSetLayoutCreateInfo::default().bindings(&bindings);
            self.layout = device.create_descriptor_set_layout(&layout, None)?;
            let pool = vk::DescriptorPoolCreateInfo::default().max_sets(1).pool_sizes(&sizes);
            self.pool = device.create_descriptor_pool(&pool, None)?;
            let layouts = [self.layout];
            let sets = vk::DescriptorSetAllocateInfo::default().descriptor_pool(self.pool).set_layouts(&layouts);
            self.handle = device.allocate_descriptor_sets(&sets)?.first().copied().unwrap_or_default();
            let writes: Vec<_> =
                (0..).zip(writes).map(|(binding, write)| write.dst_set(self.handle).dst_binding(binding)).collect();
            device.update_descriptor_sets(&writes, &[]);
        }
        Ok(())
    }
}

impl Drop for BufferSet {
    fn drop(&mut self) {
        // SAFETY: every submission is waited for; destroying the pool frees the set.
        unsafe {
            self.gpu.device.destroy_descriptor_pool(self.pool, None);
            self.gpu.device.destroy_descriptor_set_layout(self.layout, None);
        }
    }
}

/// A compute pipeline.
pub(crate) struct Pipeline {
    handle: vk::Pipeline,
    layout: vk::PipelineLayout,
    gpu: Arc<Gpu>,
}

impl Pipeline {
    /// Compiles one entry point of a WGSL source, for descriptor sets of these layouts from set 0.
    pub(crate) fn new(
        gpu: &Arc<Gpu>,
        source: &str,
        entry: &str,
        layouts: &[vk::DescriptorSetLayout],
    ) -> Result<Self, CastError> {
        let code = spirv::module(source, entry).map_err(|error| gpu.error(&error))?;
        let name = CString::new(entry).map_err(|error| gpu.error(&error))?;
        let mut pipeline = Self { handle: vk::Pipeline::null(), layout: vk::PipelineLayout::null(), gpu: gpu.clone() };
        pipeline.make(&code, &name, layouts).map_err(|error| gpu.error(&error))?;
        gpu.check()?;
        Ok(pipeline)
    }

    fn make(
        &mut self,
        code: &[u32],
        entry: &std::ffi::CStr,
        layouts: &[vk::DescriptorSetLayout],
    ) -> Result<(), vk::Result> {
        let device = &self.gpu.device;
        // SAFETY: the layouts are of this device, naga has validated the module, and the shader module may be destroyed
        // as soon as the pipeline exists. `drop` destroys the other objects, also if a later step fails.
        unsafe {
            let layout = vk::PipelineLayoutCreateInfo::default().set_layouts(layouts);
            self.layout = device.create_pipeline_layout(&layout, None)?;
            let module = device.create_shader_module(&vk::ShaderModuleCreateInfo::default().code(code), None)?;
            let mut subgroup = vk::PipelineShaderStageRequiredSubgroupSizeCreateInfo::default();
            let mut stage = vk::PipelineShaderStageCreateInfo::default()
                .stage(vk::ShaderStageFlags::COMPUTE)
                .module(module)
                .name(entry);
            if let Some(size) = self.gpu.subgroup_size {
                subgroup.required_subgroup_size = size;
                stage = stage.push_next(&mut subgroup);
            }
            let info = vk::ComputePipelineCreateInfo::default().stage(stage).layout(self.layout);
            let made = device.create_compute_pipelines(vk::PipelineCache::null(), &[info], None);
            device.destroy_shader_module(module, None);
            self.handle = made.map_err(|(_, error)| error)?.first().copied().unwrap_or_default();
        }
        Ok(())
    }

    /// Records a dispatch over `groups` workgroups with these sets.
    pub(crate) fn dispatch(&self, commands: vk::CommandBuffer, sets: &[&BufferSet], groups: (u32, u32)) {
        let handles: Vec<_> = sets.iter().map(|set| set.handle).collect();
        let device = &self.gpu.device;
        let point = vk::PipelineBindPoint::COMPUTE;
        // SAFETY: the sets have the layouts of the pipeline; the command buffer is being recorded.
        unsafe {
            device.cmd_bind_pipeline(commands, point, self.handle);
            device.cmd_bind_descriptor_sets(commands, point, self.layout, 0, &handles, &[]);
            device.cmd_dispatch(commands, groups.0, groups.1, 1);
        }
    }
}

impl Drop for Pipeline {
    fn drop(&mut self) {
        // SAFETY: every submission is waited for.
        unsafe {
            self.gpu.device.destroy_pipeline(self.handle, None);
            self.gpu.device.destroy_pipeline_layout(self.layout, None);
        }
    }
}
