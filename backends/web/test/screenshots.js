// Pictures for the README: node test/screenshots.js SIBENIK.esvo writes screenshots/*.jpg. Without a graphics device it takes minutes.
import { fileURLToPath } from 'node:url';
import { openBrowser, openPage, rest } from './browser.js';
import { serve } from './server.js';

const NAVE = 'eye=-17,-13.5,0&to=27,3.5,0';
const server = await serve({ 'sibenik.esvo': { path: process.argv[2] } });
const browser = await openBrowser();
const pictures = /** @type {[string, string, Parameters<typeof openPage>[2], string?][]} */ ([
  ['nave', `${NAVE}&movement=fly`, { width: 1280, height: 800 }, '#settings'],
  ['outside', 'light=sun', { width: 1280, height: 800 }],
  ['levels', `${NAVE}&mode=levels&pixels=4`, { width: 1280, height: 800 }],
  ['phone', NAVE, { width: 390, height: 844, scale: 2, touch: true }],
  ['phone-settings', `${NAVE}&resolution=50`, { width: 390, height: 844, scale: 2, touch: true }, '#settings'],
  ['4k', `${NAVE}&resolution=50`, { width: 3840, height: 2160 }, '#settings'],
]);
for (const [name, fragment, options, click] of pictures) {
  if (process.argv[3] && process.argv[3] !== name) continue;
  const { page } = await openPage(browser, `${server.origin}/?file=/files/sibenik.esvo#${fragment}`, options);
  await rest(page, 280000);
  if (click) await page.click(click);
  await new Promise((resolve) => setTimeout(resolve, 600));
  const to = /** @type {`${string}.jpg`} */ (fileURLToPath(new URL(`../screenshots/${name}.jpg`, import.meta.url)));
  await page.screenshot({ path: to, type: 'jpeg', quality: name === '4k' ? 60 : 75 });
  await page.close();
}
await browser.close();
server.close();
