//! Vulkan's ways to trace rays, by one interface: ray queries as the program's frames can use them, and ray-tracing pipelines.

use std::time::Instant;

use foveate::bvh::WideBvh;
use foveate::gpu::vulkan::{Context, ContextOptions};
use foveate::scene::Scene;
use foveate::trace::hardware::{Answer, Asked, RayQueries};
use foveate::trace::probe::BUNDLE;

use crate::gpu::{Gpu, Rays};

/// One of Vulkan's ways to trace rays.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Way {
    /// VK_KHR_ray_query in a compute shader.
    Queries,
    /// VK_KHR_ray_tracing_pipeline.
    Pipeline,
}

impl Way {
    pub fn name(self) -> &'static str {
        match self {
            Way::Queries => "ray queries",
            Way::Pipeline => "the ray-tracing pipeline",
        }
    }
}

/// What of both is here, with a scene.
pub struct Rivals {
    queries: Option<Queries>,
    pipeline: Option<Gpu>,
    /// What is here and how long acceleration structures took, and what is not: lines to print.
    pub told: Vec<String>,
}

struct Queries {
    rays: RayQueries,
    origins: Vec<[f32; 3]>,
    directions: Vec<[f32; 3]>,
    asked: Asked,
    answers: Vec<Answer>,
}

impl Rivals {
    /// Opens devices that have `wanted` in their names, and builds acceleration structures.
    pub fn open(wanted: &str, shape: &Scene, tree: &WideBvh) -> Result<Rivals, String> {
        let text = |error: foveate::Error| error.to_string();
        let mut told = Vec::new();
        let device = (!wanted.is_empty()).then(|| wanted.to_string());
        let options = ContextOptions { device, ray_queries: true, ..ContextOptions::default() };
        let queries = match Context::new(&options) {
            Ok(context) if context.traces_rays() => {
                let start = Instant::now();
                let rays = RayQueries::new(&context, shape, tree).map_err(text)?;
                let ms = start.elapsed().as_secs_f64() * 1e3;
                told.push(format!("ray queries by {}, made ready in {ms:.0} ms", context.report().name));
                let (origins, directions, answers) = Default::default();
                Some(Queries { rays, origins, directions, asked: Asked::Any, answers })
            }
            Ok(context) => {
                let report = context.report();
                let lacks = report.lacks_ray_queries.clone().unwrap_or_default();
                told.push(format!("ray queries: not run: {} lacks {lacks}", report.name));
                None
            }
            Err(error) => {
                told.push(format!("ray queries: not run: {error}"));
                None
            }
        };
        let mut pipeline = Gpu::open(wanted)?;
        told.push(match &mut pipeline {
            Some(gpu) => {
                let ms = gpu.build(&shape.mesh.positions, &shape.mesh.triangles)?;
                format!(
                    "the ray-tracing pipeline by {}, acceleration structure built in {ms:.0} ms",
                    gpu.name()
                )
            }
            None => {
                "the ray-tracing pipeline: not run: no device has VK_KHR_ray_tracing_pipeline".to_string()
            }
        });
        Ok(Rivals { queries, pipeline, told })
    }

    /// The ways that are here.
    pub fn ways(&self) -> Vec<Way> {
        let queries = self.queries.is_some().then_some(Way::Queries);
        queries.into_iter().chain(self.pipeline.is_some().then_some(Way::Pipeline)).collect()
    }

    /// Brings rays to all of them.
    pub fn load(&mut self, rays: &Rays) -> Result<(), String> {
        if let Some(queries) = &mut self.queries {
            queries.directions = rays.directions.to_vec();
            queries.origins = match rays.rays_per_origin {
                0 => vec![rays.eye; rays.directions.len().div_ceil(BUNDLE)],
                _ => rays.origins.to_vec(),
            };
            queries.asked = if rays.any { Asked::Any } else { Asked::Nearest };
            queries.answers = Vec::new();
        }
        self.pipeline.as_mut().map_or(Ok(()), |gpu| gpu.load(rays))
    }

    /// Traces the loaded rays; milliseconds that the device took.
    pub fn trace(&mut self, way: Way) -> Result<f64, String> {
        match (way, &mut self.queries, &self.pipeline) {
            (Way::Queries, Some(queries), _) => {
                let Queries { rays, origins, directions, asked, .. } = queries;
                let traced = rays.trace(origins, directions, *asked).map_err(|error| error.to_string())?;
                queries.answers = traced.0;
                Ok(traced.1)
            }
            (Way::Pipeline, _, Some(gpu)) => gpu.trace(),
            _ => Err(format!("{} is not here", way.name())),
        }
    }

    /// What the last trace has found, ray by ray: a distance, or what is beyond all where nothing is hit; of any hit 0.
    pub fn take_answers(&mut self, way: Way) -> Result<Vec<f32>, String> {
        let distance = |answer: Answer| match answer.hit {
            true if answer.triangle == u32::MAX => 0.0,
            true => answer.t,
            false => f32::INFINITY,
        };
        match (way, &mut self.queries, &self.pipeline) {
            (Way::Queries, Some(queries), _) => {
                Ok(std::mem::take(&mut queries.answers).into_iter().map(distance).collect())
            }
            (Way::Pipeline, _, Some(gpu)) => gpu.take_answers(),
            _ => Err(format!("{} is not here", way.name())),
        }
    }
}
