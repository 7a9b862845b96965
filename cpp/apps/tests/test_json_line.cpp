#include <doctest/doctest.h>

#include <cmath>
#include <cstdint>
#include <string>
#include <vector>

#include "json_line.hpp"
#include "latency.hpp"

using namespace ocisac::apps;

TEST_CASE("a line of JSON") {
  JsonLine line;
  line.begin();
  line.member("a", 0.1);
  line.member("b", std::nan(""));
  line.open("c");
  line.member("d", 3);
  line.member("e", "x\"\\\n\x01y");
  line.open_list("f");
  line.item("g");
  line.item(7);
  line.close_list();
  line.close();
  line.member("h", true);
  CHECK(line.end() ==
        "{\"a\":0.1,\"b\":null,\"c\":{\"d\":3,\"e\":\"x\\\"\\\\\\u000a\\u0001y\",\"f\":[\"g\",7]},\"h\":true}\n");
  line.begin();
  CHECK(line.end() == "{}\n");
}

TEST_CASE("bytes that are no UTF-8 are replaced, base64 keeps them") {
  JsonLine line;
  line.begin();
  line.member("t", "\xC3\xA9\xE2\x82\xAC\xF0\x9F\x92\xA1 \xC3 \xC0\x80 \xED\xA0\x80");
  CHECK(line.end() ==
        "{\"t\":\"\xC3\xA9\xE2\x82\xAC\xF0\x9F\x92\xA1 \\ufffd \\ufffd\\ufffd \\ufffd\\ufffd\\ufffd\"}\n");
  for (const auto& [text, want] : std::vector<std::pair<std::string, std::string>>{
           {"", ""}, {"f", "Zg=="}, {"fo", "Zm8="}, {"foo", "Zm9v"}, {"\xFF\xEE", "/+4="}}) {
    line.begin();
    line.base64("b", {reinterpret_cast<const std::uint8_t*>(text.data()), text.size()});
    CHECK(line.end() == "{\"b\":\"" + want + "\"}\n");
  }
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
