// Plays, pauses, scrubs and jumps on the page that `klasktron eval` wrote:
//   node check_eval_page.cjs CHROMIUM FOLDER [PICTURE.png]
'use strict';
const assert = require('node:assert');
const fs = require('node:fs');
const path = require('node:path');
const { chromium } = require('playwright-core');

const [program, folder, picture] = process.argv.slice(2);
const score = JSON.parse(fs.readFileSync(path.join(folder, 'score.json'), 'utf8'));

async function main() {
  const browser = await chromium.launch({ executablePath: program, args: ['--no-sandbox', '--disable-gpu'] });
  const page = await browser.newPage({ viewport: { width: 1100, height: 900 } });
  const complaints = [];
  page.on('console', (message) => { if (['error', 'warning'].includes(message.type())) { complaints.push(message.text()); } });
  page.on('pageerror', (error) => complaints.push(String(error)));
  page.on('request', (request) => { if (!request.url().startsWith('file:')) { complaints.push('asks for ' + request.url()); } });
  await page.goto('file://' + path.resolve(folder, 'index.html'));

  const replay = page.locator('#replay');
  const time = async () => Number(await replay.getAttribute('data-time'));
  const picturedBoard = () => page.locator('#replay-board').evaluate((canvas) => canvas.toDataURL());
  assert.strictEqual(await time(), 0);

  // It plays, and the board moves.
  const first = await picturedBoard();
  await page.click('#replay-play');
  await page.waitForFunction(() => 0.3 < Number(document.getElementById('replay').dataset.time));
  assert.strictEqual(await replay.getAttribute('data-playing'), 'true');
  assert.notStrictEqual(await picturedBoard(), first);

  // It pauses, and time stands still.
  await page.click('#replay-play');
  const paused = await time();
  await page.waitForTimeout(300);
  assert.strictEqual(await time(), paused);
  assert.strictEqual(await replay.getAttribute('data-playing'), 'false');

  // It scrubs.
  await page.locator('#replay-scrub').evaluate((slider) => { slider.value = '20'; slider.dispatchEvent(new Event('input')); });
  assert.ok(Math.abs(await time() - 20) < 0.01, 'scrubbed to ' + await time());

  // It jumps to an event of the list, to its neighbours, and where the timeline is clicked.
  const goals = score.matches[0].episodes.filter((episode) => episode.outcome === 'goal');
  assert.ok(0 < goals.length);
  await page.locator('#replay-events button[data-kind=goal]').first().click();
  assert.ok(Math.abs(await time() - goals[0].end_s) < 0.01, 'jumped to ' + await time() + ', the goal is at ' + goals[0].end_s);
  const goal = await time();
  await page.click('#replay-next');
  assert.ok(goal < await time());
  await page.click('#replay-back');
  assert.ok(Math.abs(await time() - goal) < 0.001);
  const line = await page.locator('#replay-timeline').boundingBox();
  await page.mouse.click(line.x + line.width / 2, line.y + line.height / 2);
  assert.ok(Math.abs(await time() - score.matches[0].duration_s / 2) < 0.2);

  // It shows only what is asked for.
  await page.selectOption('#replay-kind', 'strike');
  const strikes = score.matches[0].episodes.reduce((sum, episode) => sum + episode.strikes_left + episode.strikes_right, 0);
  assert.strictEqual(await page.locator('#replay-events button').count(), strikes);

  // At the end it stops, and playing begins anew.
  await page.locator('#replay-scrub').evaluate((slider) => { slider.value = slider.max; slider.dispatchEvent(new Event('input')); });
  await page.click('#replay-play');
  await page.waitForFunction(() => Number(document.getElementById('replay').dataset.time) < 5);
  await page.click('#replay-play');

  // Nothing is wider than the window, on a telephone either.
  for (const width of [1100, 420]) {
    await page.setViewportSize({ width, height: 900 });
    const over = await page.evaluate(() => document.documentElement.scrollWidth - window.innerWidth);
    assert.ok(over <= 0, over + ' px too wide at ' + width);
  }
  assert.deepStrictEqual(complaints, []);
  if (picture) {
    await page.setViewportSize({ width: 1100, height: 900 });
    await page.selectOption('#replay-kind', 'all');
    await page.locator('#replay-events button[data-kind=strike]').nth(3).click();
    await replay.screenshot({ path: picture });
  }
  await browser.close();
  console.log('the page of eval plays, pauses, scrubs and jumps; ' + goals.length + ' goals, ' + strikes + ' strikes');
}

main().catch((error) => { console.error(error); process.exit(1); });
