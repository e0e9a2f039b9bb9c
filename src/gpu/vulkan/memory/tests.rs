use super::super::{Commands, testing};
use super::*;

#[test]
fn bytes_go_to_the_device_and_back() {
    let Some(context) = testing::context() else { return };
    let values: Vec<u32> = (0..5000u32).map(|i| i.wrapping_mul(2_654_435_761)).collect();
    let (from, to) = (HostBuffer::new(&context, 20_000).unwrap(), HostBuffer::new(&context, 20_000).unwrap());
    assert_eq!(from.as_ptr() as usize % HOST_ALIGNMENT, 0);
    assert_eq!(from.read::<u32>(0, 5000), vec![0; 5000]);
    from.write(0, &values);
    let own = DeviceBuffer::new(&context, 20_000).unwrap();
    let mut commands = Commands::new(&context).unwrap();
    commands.begin().unwrap();
    commands.copy(&(&from).into(), &(&own).into(), 20_000);
    commands.barrier();
    commands.copy(&BufferRef::from(&own).part(4000, 16_000), &(&to).into(), 16_000);
    commands.end_stage("copies");
    commands.submit().unwrap();
    // What is in use stays, whoever else lets go of it.
    drop((from, own));
    assert_eq!(commands.wait().unwrap()[0].stage, "copies");
    assert_eq!(to.read::<u32>(0, 4000), values[1000..]);
    testing::assert_valid(&context);
}

/// Another allocation that imports the descriptor is the same memory: what one writes, the other reads.
#[test]
fn exported_memory_is_the_same_memory_elsewhere() {
    use std::os::fd::IntoRawFd;
    let Some(context) = testing::context() else { return };
    let Ok((buffer, fd)) = HostBuffer::exported(&context, 20_000) else {
        assert!(!context.report().exports_memory || !exports_storage(&context), "it says that it can");
        println!("not run: {} exports no memory", context.report().name);
        return;
    };
    let values: Vec<u32> = (0..5000u32).map(|i| i.wrapping_mul(2_654_435_761)).collect();
    buffer.write(0, &values);
    let device = &context.0.device;
    let mut import = vk::ImportMemoryFdInfoKHR::default().handle_type(VULKAN_TYPE).fd(fd.into_raw_fd());
    // SAFETY: the buffer was made by this device; the import has the size and the type of the exported
    // memory, and is freed after its mapping was read.
    let read: Vec<u32> = unsafe {
        let needs = device.get_buffer_memory_requirements(buffer.0.buffer);
        let base = vk::MemoryPropertyFlags::HOST_VISIBLE | vk::MemoryPropertyFlags::HOST_COHERENT;
        let kinds = &context.0.memory.memory_types[..context.0.memory.memory_type_count as usize];
        let local = if buffer.0.local { vk::MemoryPropertyFlags::DEVICE_LOCAL } else { base };
        let kind = (0..kinds.len())
            .find(|&kind| {
                needs.memory_type_bits >> kind & 1 == 1 && kinds[kind].property_flags.contains(base | local)
            })
            .unwrap();
        let info = vk::MemoryAllocateInfo::default()
            .allocation_size(needs.size)
            .memory_type_index(kind as u32)
            .push_next(&mut import);
        let memory = device.allocate_memory(&info, None).unwrap();
        let start = device.map_memory(memory, 0, vk::WHOLE_SIZE, vk::MemoryMapFlags::empty()).unwrap();
        let read = std::slice::from_raw_parts(start.cast::<u32>(), 5000).to_vec();
        device.free_memory(memory, None);
        read
    };
    assert_eq!(read, values);
    testing::assert_valid(&context);
}

#[test]
fn what_does_not_fit_is_refused() {
    let Some(context) = testing::context() else { return };
    let buffer = HostBuffer::new(&context, 64).unwrap();
    assert!(std::panic::catch_unwind(|| buffer.write(61, &[0u32])).is_err());
    assert!(std::panic::catch_unwind(|| buffer.read::<u32>(usize::MAX, 1)).is_err());
    assert!(matches!(DeviceBuffer::new(&context, 1 << 46), Err(Error::Device { .. })));
}
