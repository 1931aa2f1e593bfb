//! `esvo kernel`.

use std::path::PathBuf;

use clap::{Args, ValueEnum};
use esvo_core::BEAM_BLOCK;
use esvo_core::filter::kernel::FILTER_WGSL;
use esvo_core::gpu::arithmetic::Arithmetic;
use esvo_core::gpu::kernel::{Variant, WORKGROUP};
use esvo_core::gpu::slots::Slots;
use esvo_core::gpu::triangles::{MAX_STACK, TrianglePlacement};

use crate::fail::{Failure, print};
use crate::files::open;
use crate::values::{parse_beam_block, parse_size};

/// Print the WGSL of a GPU kernel, as the engines compile it.
#[derive(Debug, Args)]
#[command(after_help = "\
A browser or another engine can take it as it is: it is core WebGPU, but for --texture. Its comments name the structs and
bindings. A feature that is left out is a constant that is false, so that compilers remove its code.

Examples:
  esvo kernel sibenik.esvo > cast.wgsl                what this octree needs, and nothing else
  esvo kernel --pass filter > filter.wgsl             the post-process filter
  esvo kernel --pass triangles > triangles.wgsl       rays at triangles
  esvo kernel --levels 12 --no-contours --beam        without an octree")]
pub(crate) struct KernelArguments {
    /// Contours, far pointers and levels as this octree needs them
    pub(crate) file: Option<PathBuf>,
    /// What the kernel does
    #[arg(long, value_enum, default_value_t = KernelPass::Main)]
    pub(crate) pass: KernelPass,
    /// Without contours: voxels are cubes
    #[arg(long)]
    pub(crate) no_contours: bool,
    /// Without far pointers
    #[arg(long)]
    pub(crate) no_far_pointers: bool,
    /// Rays end at leaves only
    #[arg(long)]
    pub(crate) no_lod: bool,
    /// Rays start where the coarse pass found that they may
    #[arg(long)]
    pub(crate) beam: bool,
    /// Edge of a block of pixels of the coarse pass: 4 or 8
    #[arg(long, value_name = "PIXELS", default_value_t = BEAM_BLOCK, value_parser = parse_beam_block)]
    pub(crate) beam_block: u32,
    /// Levels of the deepest octree [default: those of the file, else 23]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=23))]
    pub(crate) levels: Option<u32>,
    /// Bindings that hold the octree; for triangles, those that hold the nodes, and as many behind them
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = clap::value_parser!(u32).range(1..=64))]
    pub(crate) parts: u32,
    /// With several bindings, each but the last holds 2^N slots: of 8 bytes, of triangles and their nodes 16
    #[arg(long, value_name = "N", default_value_t = 24, value_parser = clap::value_parser!(u32).range(0..=31))]
    pub(crate) part_shift: u32,
    /// The octree is in a storage texture, each row of which holds 2^N slots: for drivers that run on the processor. Needs
    /// WGSL's language feature readonly_and_readwrite_storage_textures, which is not in every browser
    #[arg(long, value_name = "N", conflicts_with_all = ["parts", "part_shift"], value_parser = clap::value_parser!(u32).range(5..=14))]
    pub(crate) texture: Option<u32>,
    /// Size of a workgroup, powers of two
    #[arg(long, value_name = "WxH", value_parser = parse_size)]
    pub(crate) workgroup: Option<[u32; 2]>,
}

/// A kernel.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum KernelPass {
    /// The hits of a picture: entry point `main_pass`; `timing_pass` stores depths alone
    Main,
    /// Where the rays of a block of pixels may start: entry point `coarse_pass`
    Coarse,
    /// The hits of a list of rays: entry point `cast_rays`
    Rays,
    /// The nearest hits of a picture of many placed objects: entry point `instances_pass`
    Instances,
    /// The post-process filter: entry point `filter_band`
    Filter,
    /// The hits of rays at triangles: entry points `triangles_pass` for a picture, `triangles_rays` and `triangles_any` for a list of
    /// rays. Takes --parts, --part-shift, --texture and --workgroup
    Triangles,
}

pub(crate) fn run_kernel(arguments: &KernelArguments) -> Result<(), Failure> {
    let needs = match &arguments.file {
        Some(file) => Some(open(file, false)?.needs()),
        None => None,
    };
    let (width, height) = arguments.workgroup.map_or(WORKGROUP, |[width, height]| (width, height));
    if !width.is_power_of_two() || !height.is_power_of_two() || width * height > 256 {
        return Err(
            format!("--workgroup {width}x{height}: expected powers of two, at most 256 in all, e.g. 8x8").into()
        );
    }
    let rays = arguments.pass == KernelPass::Rays;
    let instances = arguments.pass == KernelPass::Instances;
    let slots = match arguments.texture {
        Some(row_shift) => Slots::Texture { row_shift },
        None => Slots::Buffers { parts: arguments.parts, part_shift: arguments.part_shift },
    };
    let variant = Variant {
        contours: !arguments.no_contours && needs.is_none_or(|needs| needs.contours),
        far_pointers: !arguments.no_far_pointers && needs.is_none_or(|needs| needs.far_pointers),
        lod: !arguments.no_lod,
        beam: arguments.beam && !rays && !instances,
        rays,
        instances,
        beam_block: arguments.beam_block,
        levels: arguments.levels.or(needs.map(|needs| needs.levels)).unwrap_or(23),
        slots,
        workgroup: (width, height),
        arithmetic: Arithmetic::EXACT,
    };
    match arguments.pass {
        KernelPass::Filter => print(FILTER_WGSL),
        KernelPass::Triangles => {
            let workgroup = (width, height);
            print(&TrianglePlacement { nodes: slots, triangles: slots, stack: MAX_STACK, workgroup }.source())
        }
        KernelPass::Coarse => print(&variant.of_coarse_pass().source()),
        KernelPass::Main | KernelPass::Rays | KernelPass::Instances => print(&variant.source()),
    }
}
