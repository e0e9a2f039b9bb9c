// Compresses a scene in each way that the loader reads, for tests and measurements.
//
//   node compress-scenes.mjs scene.glb FOLDER
//
// writes FOLDER/draco.glb and meshopt.glb. Needs the packages that scripts/compress-scenes.sh installs.
import { join } from 'node:path';
import { Logger, NodeIO } from '@gltf-transform/core';
import {
  ALL_EXTENSIONS,
  EXTMeshoptCompression,
  KHRDracoMeshCompression,
} from '@gltf-transform/extensions';
import { dequantize, quantize, reorder, weld } from '@gltf-transform/functions';
import draco3d from 'draco3dgltf';
import { MeshoptDecoder, MeshoptEncoder } from 'meshoptimizer';

const [source, folder] = process.argv.slice(2);
if (!folder) {
  console.error('usage: node compress-scenes.mjs scene.glb FOLDER');
  process.exit(2);
}
await MeshoptDecoder.ready;
await MeshoptEncoder.ready;
const io = new NodeIO().registerExtensions(ALL_EXTENSIONS).registerDependencies({
  'draco3d.decoder': await draco3d.createDecoderModule(),
  'draco3d.encoder': await draco3d.createEncoderModule(),
  'meshopt.decoder': MeshoptDecoder,
  'meshopt.encoder': MeshoptEncoder,
});

async function write(name, change) {
  const document = await io.read(source);
  document.setLogger(new Logger(Logger.Verbosity.ERROR));
  await change(document);
  await io.write(join(folder, name), document);
}

// Both quantize by themselves, and take floats.
await write('draco.glb', async (document) => {
  await document.transform(dequantize(), weld());
  const { EDGEBREAKER } = KHRDracoMeshCompression.EncoderMethod;
  const extension = document.createExtension(KHRDracoMeshCompression).setRequired(true);
  extension.setEncoderOptions({ method: EDGEBREAKER, quantizationBits: { POSITION: 16 } });
});
await write('meshopt.glb', async (document) => {
  await document.transform(
    dequantize(),
    weld(),
    reorder({ encoder: MeshoptEncoder }),
    quantize({ quantizePosition: 16 }),
  );
  const extension = document.createExtension(EXTMeshoptCompression).setRequired(true);
  extension.setEncoderOptions({ method: EXTMeshoptCompression.EncoderMethod.FILTER });
});
