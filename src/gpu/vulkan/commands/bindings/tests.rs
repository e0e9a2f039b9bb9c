use super::*;
use crate::gpu::vulkan::{
    BottomLevel, Commands, ComputePipeline, HostBuffer, Placement, RayPipeline, Shader, TopLevel, Triangles,
    testing,
};

const SHADER: Shader = Shader {
    name: "filter.wgsl",
    words: include_bytes!(concat!(env!("OUT_DIR"), "/filter.spv")),
    buffers: 5,
    push: PUSH as u32,
};
const PUSH: usize = 112;
/// Where its push constants tell how many samples there are.
const COUNT: usize = 80;

/// A sample whose three words of radiance are this.
fn sample(context: &Context, radiance: f32) -> HostBuffer {
    let buffer = HostBuffer::new(context, 48).unwrap();
    buffer.write(0, &[radiance; 12]);
    buffer
}

/// What the shader makes of it: twice in one submission, to the same place.
fn run(
    commands: &mut Commands,
    pipeline: &ComputePipeline,
    sample: &HostBuffer,
    rest: [&HostBuffer; 2],
) -> [u32; 2] {
    let mut push = [0u8; PUSH];
    push[COUNT] = 1;
    let [from, to, dropped] = [sample.into(), rest[0].into(), rest[1].into()];
    let buffers: [Option<&BufferRef>; 5] = [Some(&from), Some(&to), Some(&dropped), None, None];
    commands.begin().unwrap();
    for _ in 0..2 {
        commands.dispatch(pipeline, &buffers, &push, [1, 1, 1]).unwrap();
        commands.barrier();
    }
    commands.submit().unwrap();
    commands.wait().unwrap();
    rest[0].read(0, 2).try_into().unwrap()
}

/// Sets are used again for the same buffers and for no others, though these may lie where others lay, and go when
/// nobody asks for them any more.
#[test]
fn sets_are_kept_for_what_they_bind() {
    let Some(context) = testing::context() else { return };
    let pipeline = ComputePipeline::new(&context, &SHADER, "take_radiance").unwrap();
    let mut commands = Commands::new(&context).unwrap();
    let (to, dropped) = (sample(&context, 0.0), sample(&context, 0.0));
    let rest = [&to, &dropped];
    let mut samples = [1.0, 2.0].map(|radiance| sample(&context, radiance));
    let first: Vec<_> = samples.iter().map(|sample| run(&mut commands, &pipeline, sample, rest)).collect();
    assert_ne!(first[0], first[1]);
    let handles: Vec<_> = commands.bindings.sets.iter().map(|set| set.handle).collect();
    assert_eq!(handles.len(), 2, "one for each");
    for turn in 0..6 {
        assert_eq!(run(&mut commands, &pipeline, &samples[turn % 2], rest), first[turn % 2]);
    }
    assert!(commands.bindings.sets.iter().map(|set| set.handle).eq(handles), "the same ones");
    for radiance in [3.0, 4.0, 5.0] {
        samples[0] = sample(&context, radiance);
        let fresh = run(&mut commands, &pipeline, &samples[0], rest);
        assert!(!first.contains(&fresh), "{radiance}: {fresh:?}");
    }
    let taken = commands.bindings.taken;
    for _ in 0..=KEPT {
        run(&mut commands, &pipeline, &samples[0], rest);
    }
    assert_eq!(commands.bindings.sets.len(), 1, "others were not asked for any more");
    let spare = commands.bindings.spare.len();
    assert_eq!(spare as u32 + 1, taken.0, "all are still there");
    // What was given up is written anew, and all of it before the pool gives more.
    let others: Vec<_> = (0..spare).map(|turn| sample(&context, 6.0 + turn as f32)).collect();
    for other in &others {
        let fresh = run(&mut commands, &pipeline, other, rest);
        assert!(!first.contains(&fresh), "{fresh:?}");
    }
    assert_eq!(commands.bindings.taken, taken, "none is new");
    drop(commands);
    testing::assert_valid(&context);
}

/// A pool that is full of sets of earlier submissions has room again, for sets of any pipeline.
#[test]
fn sets_make_room_for_others() {
    let Some(context) = testing::context() else { return };
    let pipeline = || ComputePipeline::new(&context, &SHADER, "take_radiance").unwrap();
    let (one, other) = (pipeline(), pipeline());
    let mut bindings = Bindings::new(&context).unwrap();
    let buffer = HostBuffer::new(&context, 1 << 20).unwrap();
    let all = BufferRef::from(&buffer);
    let parts: Vec<BufferRef> = (0..BINDINGS as usize / 5).map(|part| all.part(part * 1024, 48)).collect();
    for pipeline in [&one, &other, &one] {
        bindings.begin().unwrap();
        for part in &parts {
            bindings.set(&pipeline.0, &[Some(part), None, None, None, None], None).unwrap();
        }
        assert_eq!(bindings.sets.len(), parts.len());
    }
    bindings.begin().unwrap();
    bindings.set(&one.0, &[None, Some(&parts[0]), None, None, None], None).unwrap();
    assert_eq!((bindings.sets.len(), bindings.taken), (1, (1, 5)), "the pool had no room for one more");
    // SAFETY: nothing was submitted.
    unsafe { bindings.destroy() };
    testing::assert_valid(&context);
}

/// Of a set that is given up the pipeline counts, whose layout it has.
#[test]
fn sets_of_one_pipeline_are_no_other_ones() {
    let Some(context) = testing::context() else { return };
    let of = |entry| ComputePipeline::new(&context, &SHADER, entry).unwrap();
    let (one, other) = (of("take_radiance"), of("take_radiance"));
    let mut bindings = Bindings::new(&context).unwrap();
    let buffer = HostBuffer::new(&context, 1 << 12).unwrap();
    let part = BufferRef::from(&buffer);
    let set = |bindings: &mut Bindings, pipeline: &ComputePipeline| {
        bindings.begin().unwrap();
        bindings.set(&pipeline.0, &[Some(&part), None, None, None, None], None).unwrap()
    };
    let first = set(&mut bindings, &one);
    for _ in 0..KEPT {
        bindings.begin().unwrap();
    }
    assert_ne!(set(&mut bindings, &other), first, "it has another's layout");
    assert_eq!(bindings.spare.len(), 1, "the first one was given up before");
    assert_eq!(set(&mut bindings, &one), first, "it is written anew");
    // SAFETY: nothing was submitted.
    unsafe { bindings.destroy() };
    testing::assert_valid(&context);
}

const RAYS: Shader = Shader {
    name: "rays.wgsl",
    words: include_bytes!(concat!(env!("OUT_DIR"), "/rays.spv")),
    buffers: 4,
    push: 16,
};

/// A square across the z axis, so far away.
fn square(context: &Context, z: f32) -> TopLevel {
    let corner = |x: f32, y: f32| [x, y, z];
    let [a, b, c, d] = [corner(-1.0, -1.0), corner(-1.0, 1.0), corner(1.0, 1.0), corner(1.0, -1.0)];
    let corners: Vec<[f32; 9]> =
        [[a, b, c], [a, c, d]].iter().map(|corners| corners.as_flattened().try_into().unwrap()).collect();
    let shape = BottomLevel::build(context, &[Triangles { corners: &corners, opaque: true }]).unwrap();
    let world_from_shape = [[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0]];
    TopLevel::build(context, &[Placement { shape, world_from_shape, culled: false }]).unwrap()
}

/// Acceleration structures are told apart too, with the same buffers beside them: also one whose memory another had.
#[test]
fn sets_are_kept_for_the_structures_that_they_bind() {
    let Some(context) = testing::tracing_context() else { return };
    let pipeline = RayPipeline::new(&context, &RAYS, "intersect_rays").unwrap();
    let mut commands = Commands::new(&context).unwrap();
    let buffers = [72, 16, 16, 16].map(|size| HostBuffer::new(&context, size).unwrap());
    let bound = buffers.each_ref().map(BufferRef::from);
    // As `kernels/rays.wgsl` has it: planes of one word each, and the ray's origin behind them.
    let (sought, t, origin) = (64u32, 4, 15u32);
    let mut distance = |structure: &TopLevel| -> f32 {
        let mut words = [0u32; 18];
        (words[0], words[3], words[t]) = (sought, 1f32.to_bits(), f32::INFINITY.to_bits());
        // Beside the edge that both triangles have.
        words[origin as usize] = 0.5f32.to_bits();
        buffers[0].write(0, &words);
        commands.begin().unwrap();
        let push = [1u32, 1, origin, 1];
        let bound = bound.each_ref().map(Some);
        commands.trace(&pipeline, structure, &bound, bytemuck::bytes_of(&push), [1, 1, 1]).unwrap();
        commands.submit().unwrap();
        commands.wait().unwrap();
        f32::from_bits(buffers[0].read::<u32>(4 * t, 1)[0])
    };
    let mut structures = [2.0, 3.0].map(|z| square(&context, z));
    for turn in 0..4 {
        let found = distance(&structures[turn % 2]);
        assert_eq!(found, [2.0, 3.0][turn % 2], "turn {turn}");
    }
    for z in [4.0, 5.0, 6.0] {
        structures[0] = square(&context, z);
        assert_eq!(distance(&structures[0]), z);
    }
    drop(commands);
    testing::assert_valid(&context);
}
