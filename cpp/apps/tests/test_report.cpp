#include <doctest/doctest.h>

#include <cmath>
#include <cstdint>
#include <string>
#include <vector>

#include "latency.hpp"
#include "report.hpp"

using namespace ocisac::apps;

namespace {

ocisac::LightFrame frame_with(const std::string& payload) {
  ocisac::LightFrame light{};
  light.frame = 7;
  light.received = ocisac::nothing_received(7);
  light.received->rows_per_chip = 0.1;
  light.received->stretch.emplace();
  light.received->stretch->payload.emplace();
  light.received->stretch->payload->bytes.assign(payload.begin(), payload.end());
  return light;
}

std::string line_of(const ocisac::LightFrame& light) {
  return light_line(light, {1, 2, 3, 4}, 9, {.row_time = 1, .exposure = {}, .frame_time = {}, .tone_curve = {}});
}

}  // namespace

TEST_CASE("a line of JSON: numbers that read back as the same, null where not finite, one object a line") {
  const std::string line = line_of(frame_with("x\"\\\n\x01y"));
  CHECK(line.find("{\"frame\":7,\"source\":0,\"rows\":9,\"region\":[1,2,3,4],\"bits\":\"\",\"rows_per_chip\":0.1,") ==
        0);
  CHECK(line.find("\"snr_db\":null") != std::string::npos);
  CHECK(line.find("\"payload\":\"x\\\"\\\\\\n\\u0001y\"") != std::string::npos);
  CHECK(line.find('\n') == line.size() - 1);
}

TEST_CASE("bytes that are no UTF-8 are replaced, base64 keeps them") {
  const std::string bad = "\uFFFD";
  const std::string good = "\xC3\xA9\xE2\x82\xAC\xF0\x9F\x92\xA1 ";
  const std::string line = line_of(frame_with(good + "\xC3 \xC0\x80 \xED\xA0\x80"));
  CHECK(line.find("\"payload\":\"" + good + bad + " " + bad + bad + " " + bad + bad + bad + "\"") != std::string::npos);
  for (const auto& [text, want] : std::vector<std::pair<std::string, std::string>>{
           {"", ""}, {"f", "Zg=="}, {"fo", "Zm8="}, {"foo", "Zm9v"}, {"\xFF\xEE", "/+4="}})
    CHECK(base64({reinterpret_cast<const std::uint8_t*>(text.data()), text.size()}) == want);
}

TEST_CASE("percentiles of latency") {
  Latency latency;
  CHECK(std::isnan(latency.percentile(0.5)));
  for (int k = 1; k <= 1000; ++k) latency.add(k * 1e-5);
  CHECK(latency.percentile(0.5) == doctest::Approx(5e-3).epsilon(0.022));
  CHECK(latency.percentile(0.99) == doctest::Approx(9.9e-3).epsilon(0.022));
  CHECK(latency.percentile(1) == 1e-2);
  CHECK(latency.largest() == 1e-2);
  CHECK(latency.mean() == doctest::Approx(5.005e-3));
  latency.add(1e9);
  latency.add(0);
  CHECK(latency.largest() == 1e9);
}
