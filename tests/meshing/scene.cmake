add_gtest(test_scene unit scene)
add_gtest(test_record unit scene VTK::IOXML)
