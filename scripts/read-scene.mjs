// Reads a scene by gltf-transform, for measurements beside ours: its geometry decoded, its pictures as they are.
//
//   node read-scene.mjs scene.glb
//
// Needs the packages that scripts/compress-scenes.sh installs, which copies it beside them.
import { NodeIO } from '@gltf-transform/core';
import { ALL_EXTENSIONS } from '@gltf-transform/extensions';
import draco3d from 'draco3dgltf';
import { MeshoptDecoder } from 'meshoptimizer';

const [source] = process.argv.slice(2);
if (!source) {
  console.error('usage: node read-scene.mjs scene.glb');
  process.exit(2);
}
await MeshoptDecoder.ready;
const io = new NodeIO().registerExtensions(ALL_EXTENSIONS).registerDependencies({
  'draco3d.decoder': await draco3d.createDecoderModule(),
  'meshopt.decoder': MeshoptDecoder,
});
const document = await io.read(source);
console.log(`${document.getRoot().listMeshes().length} meshes`);
