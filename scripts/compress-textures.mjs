// Compresses a scene's textures by Basis Universal in both ways that KHR_texture_basisu knows, for tests.
//
//   node compress-textures.mjs scene.glb FOLDER
//
// writes FOLDER/etc1s.glb and uastc.glb with two triangles of each primitive, and etc1s-decoded.glb and
// uastc-decoded.glb, whose textures are what Basis Universal's own decoder makes of theirs, as PNG. Needs the
// packages that scripts/compress-scenes.sh installs.
import { join } from 'node:path';
import { Logger, NodeIO } from '@gltf-transform/core';
import { ALL_EXTENSIONS, KHRTextureBasisu } from '@gltf-transform/extensions';
import { compactPrimitive, dequantize, prune } from '@gltf-transform/functions';
import { encodeToKTX2 } from 'ktx2-encoder';
import { PNG } from 'pngjs';
import BASIS from './node_modules/ktx2-encoder/dist/basis/basis_encoder.js';

const [source, folder] = process.argv.slice(2);
if (!folder) {
  console.error('usage: node compress-textures.mjs scene.glb FOLDER');
  process.exit(2);
}
const RGBA32 = 13;
const io = new NodeIO().registerExtensions(ALL_EXTENSIONS);
const basis = await BASIS();
basis.initializeBasis();

/** Level 0 of a KTX2 file as PNG. */
function decoded(bytes) {
  const file = new basis.KTX2File(bytes);
  file.startTranscoding();
  const png = new PNG({ width: file.getWidth(), height: file.getHeight() });
  const texels = new Uint8Array(file.getImageTranscodedSizeInBytes(0, 0, 0, RGBA32));
  if (!file.transcodeImage(texels, 0, 0, 0, RGBA32, 0, -1, -1)) throw new Error('a texture is not decoded');
  file.delete();
  png.data.set(texels);
  return new Uint8Array(PNG.sync.write(png));
}

async function thinned() {
  const document = await io.read(source);
  document.setLogger(new Logger(Logger.Verbosity.ERROR));
  await document.transform(dequantize());
  for (const mesh of document.getRoot().listMeshes()) {
    for (const primitive of mesh.listPrimitives()) {
      const indices = primitive.getIndices();
      primitive.setIndices(indices.clone().setArray(indices.getArray().slice(0, 6)));
      compactPrimitive(primitive);
    }
  }
  await document.transform(prune());
  return document;
}

for (const name of ['etc1s', 'uastc']) {
  const document = await thinned();
  const textures = document.getRoot().listTextures();
  for (const [number, texture] of textures.entries()) {
    const options = {
      isUASTC: name === 'uastc',
      // Every other one as it is, without Zstandard.
      needSupercompression: number % 2 === 0,
      generateMipmap: true,
      isSetKTX2SRGBTransferFunc: true,
      imageDecoder: (bytes) => PNG.sync.read(Buffer.from(bytes)),
    };
    const bytes = await encodeToKTX2(texture.getImage(), options);
    texture.setImage(new Uint8Array(bytes)).setMimeType('image/ktx2');
  }
  document.createExtension(KHRTextureBasisu).setRequired(true);
  await io.write(join(folder, `${name}.glb`), document);
  document.disposeExtension('KHR_texture_basisu');
  textures.forEach((texture) => texture.setImage(decoded(texture.getImage())).setMimeType('image/png'));
  await io.write(join(folder, `${name}-decoded.glb`), document);
}
