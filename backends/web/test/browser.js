// Chromium with its software WebGPU.
import { existsSync } from 'node:fs';
import { launch } from 'puppeteer-core';

const PATHS = [process.env.CHROMIUM ?? '', '/usr/bin/chromium', '/usr/bin/chromium-browser', '/usr/bin/google-chrome'];

/** Why the tests of the page cannot run here, or false. */
export function missing() {
  if (PATHS.some((path) => path && existsSync(path))) return false;
  if (process.env.ESVO_REQUIRE_CHROMIUM === '1') throw new Error('ESVO_REQUIRE_CHROMIUM is set, but there is no Chromium');
  return 'no Chromium here (Debian: chromium)';
}

/** @param {string[]} [more] Arguments. */
export function openBrowser(more = ['--enable-unsafe-webgpu', '--use-webgpu-adapter=swiftshader', '--enable-features=Vulkan', '--use-vulkan=swiftshader', '--use-angle=swiftshader', '--enable-unsafe-swiftshader']) {
  return launch({
    executablePath: PATHS.find((path) => path && existsSync(path)), headless: true, dumpio: Boolean(process.env.DUMP), args: ['--no-sandbox', '--disable-dev-shm-usage', ...more], protocolTimeout: 300000,
  });
}

/**
 * A page that says what goes wrong in it.
 * @param {import('puppeteer-core').Browser} browser
 * @param {string} address
 * @param {{ width?: number, height?: number, scale?: number, touch?: boolean, before?: () => void }} [options]
 */
export async function openPage(browser, address, { width = 1024, height = 768, scale = 1, touch = false, before } = {}) {
  const page = await browser.newPage();
  await page.setViewport({ width, height, deviceScaleFactor: scale, hasTouch: touch, isMobile: touch });
  /** @type {string[]} */
  const errors = [];
  page.on('pageerror', (error) => errors.push(String(error)));
  page.on('console', (message) => message.type() === 'error' && errors.push(message.text()));
  if (before) await page.evaluateOnNewDocument(before);
  await page.goto(address);
  return { page, errors };
}

/**
 * Waits until the picture shows all that it should, or a message does.
 * @param {import('puppeteer-core').Page} page
 * @param {number} [timeout]
 */
export async function rest(page, timeout = 60000) {
  await page.waitForFunction(() => {
    const { viewer } = /** @type {any} */ (globalThis).esvo ?? {};
    return document.getElementById('message')?.hidden === false || (viewer?.atRest && viewer.frames > 0 && viewer.renderer?.drawn);
  }, { timeout, polling: 50 });
}

/** @param {import('puppeteer-core').Page} page */
export function message(page) {
  return page.evaluate(() => {
    const box = document.getElementById('message');
    return box?.hidden === false ? box.querySelector('p')?.textContent ?? '' : '';
  });
}
